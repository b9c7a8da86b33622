"""A random exciting motion within the limits, at once: for trying things out."""

import numpy as np

from idim_iv_ros.configuration import Configuration
from idim_iv_ros.errors import DataError, UsageError
from idim_iv_ros.excitation.excite import load_model
from idim_iv_ros.excitation.fourier import FourierBasis
from idim_iv_ros.excitation.heights import moving_frames
from idim_iv_ros.excitation.limit_use import limit_use
from idim_iv_ros.excitation.limits import motion_limits
from idim_iv_ros.excitation.sampling import require_sampling
from idim_iv_ros.excitation.trajectory import Trajectory

_HIGHEST_FREQUENCY = 2.0  # Hz
_LONGEST = 1000.0  # s; the work grows with the square of the duration
_SHRINK = 0.8
_ATTEMPTS = 20


def random_motion(
    configuration: Configuration, *, duration: float, rate: float, seed: int
) -> Trajectory:
    """One period of a random Fourier series up to 2 Hz, at rest at both ends, within every limit.

    Fast, unlike a motion designed for its condition number, which is the same at any speed; but
    nothing is optimised. `design_excitation` does that.

    Parameters
    ----------
    duration
        s.
    rate
        Samples per second.
    seed
        Of the coefficients.

    Raises
    ------
    UsageError
        No URDF, a limit that is missing, a duration that is not 1 to 1000 s, or as
        `require_sampling`.
    DataError
        The robot cannot even stay near the middle of its range.
    """
    if not duration >= 1.0:
        raise UsageError(f"duration {duration:g}: at least 1 s is needed")
    if duration > _LONGEST:
        raise UsageError(
            f"duration {duration:g}: a random motion lasts at most {_LONGEST:g} s; design a "
            "longer one with idim-iv excite --for diagnosis"
        )
    require_sampling(rate, duration, "the random motion")
    model = load_model(configuration)
    limits = motion_limits(model, configuration)
    random = np.random.default_rng(seed)
    joints = len(limits.lower)
    basis = FourierBasis(duration, round(_HIGHEST_FREQUENCY * duration))
    coefficients = random.normal(size=(basis.size, joints))
    posture = limits.middle + limits.half_range * random.uniform(-0.2, 0.2, joints)
    time = np.arange(round(duration * rate) + 1) / rate
    wave, slope, curve = basis.motion(time, coefficients)
    room = limits.margin * limits.half_range - np.abs(posture - limits.middle)
    scale = np.minimum(room / np.abs(wave).max(axis=0), limits.velocity / np.abs(slope).max(axis=0))
    scale = np.minimum(scale, limits.acceleration / np.abs(curve).max(axis=0)) * limits.margin
    frames = moving_frames(model.robot)
    for _ in range(_ATTEMPTS):
        motion = Trajectory(
            tuple(model.robot.joints), rate, posture + scale * wave, scale * slope, scale * curve
        )
        if limit_use(model.robot, limits, frames, motion).within(limits):
            return motion
        scale = _SHRINK * scale
    raise DataError(
        "no random motion keeps the torque limits: design one with idim-iv excite, or look at "
        "the effort limits of the URDF"
    )
