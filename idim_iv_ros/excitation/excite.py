"""From a configuration to a motion: designed, or random."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from idim_iv_ros.configuration import Configuration
from idim_iv_ros.errors import DataError, UsageError
from idim_iv_ros.excitation.criterion import PredictedParameter, predict_parameters
from idim_iv_ros.excitation.design import Design, DesignSettings, design_excitation
from idim_iv_ros.excitation.files import motion_document
from idim_iv_ros.excitation.fourier import FourierBasis
from idim_iv_ros.excitation.limits import MotionLimits, limit_use, motion_limits
from idim_iv_ros.excitation.trajectory import Trajectory, require_sampling
from idim_iv_ros.model import InverseModel, build_inverse_model, read_urdf_file
from idim_iv_ros.progress import Progress

_LEAST_NOISE = 1e-6  # of the torque limit: no effort is measured more finely

_HIGHEST_FREQUENCY = 2.0  # Hz
_SERVO_SECONDS = 20.0
_LONGEST = 1000.0  # s; the work grows with the square of the duration
_SHRINK = 0.8
_ATTEMPTS = 20


@dataclass(frozen=True)
class Excitation:
    """A motion for identification with its figures."""

    design: Design
    parameters: tuple[PredictedParameter, ...]  # The worst first
    torque_noise: float  # Share of each torque limit that `parameters` assumes
    document: Mapping[str, object] = field(repr=False)  # All figures, as they are written to JSON


def load_model(configuration: Configuration) -> InverseModel:
    """Build the nominal model, with torques in N m whatever the recordings hold.

    Raises UsageError: the configuration names no URDF, or one that cannot be used.
    """
    urdf = configuration.robot.description
    if urdf is None:
        source = configuration.source
        raise UsageError(f"{source}: robot.urdf or robot.mjcf is needed to design a motion")
    text = read_urdf_file(urdf)
    return build_inverse_model(configuration.changed("signals", effort_unit="N m"), text, str(urdf))


def excite(
    model: InverseModel,
    limits: MotionLimits,
    settings: DesignSettings,
    *,
    torque_noise: float = 0.005,
    progress: Progress | None = None,
) -> Excitation:
    """Design a motion for identification and predict what it shows.

    - `torque_noise`: standard deviation of the torque noise at each sample, share of the torque
      limit

    Raises UsageError or DataError: see `motion_limits`, `design_excitation`, `predict_parameters`.
    """
    if not _LEAST_NOISE <= torque_noise < 1.0:
        raise UsageError(
            f"torque noise {torque_noise:g}: a share from {_LEAST_NOISE:g} to below 1 is needed"
        )
    design = design_excitation(model, limits, settings, progress)
    parameters = predict_parameters(
        model, design.period, settings.repeats, limits.torque, torque_noise
    )
    document = motion_document(
        "identification",
        model.robot.name,
        design.trajectory,
        limits,
        design.use,
        {
            **vars(settings),
            "start": None if settings.start is None else list(map(float, settings.start)),
            "torque_noise": torque_noise,
        },
        ended_early=design.ended_early,
        seconds=round(design.seconds, 2),
        condition_number={"random_median": vars(design.before), "designed": vars(design.after)},
        parameters=[
            {**vars(parameter), "relative_std": parameter.relative_std, "bad": parameter.bad}
            for parameter in parameters
        ],
    )
    return Excitation(design, parameters, torque_noise, document)


def random_motion(
    configuration: Configuration,
    *,
    duration: float,
    rate: float,
    seed: int,
    limits: MotionLimits | None = None,
) -> Trajectory:
    """One period of a random Fourier series up to 2 Hz, at rest at both ends, within every limit.

    Fast, unlike a motion designed for its condition number, which is the same at any speed; but
    nothing is optimised. `design_excitation` does that.

    - `duration`: s
    - `rate`: samples per second
    - `seed`: of the coefficients
    - `limits`: what it may use; else those of `motion_limits`

    Raises UsageError: no URDF, a limit that is missing, a duration that is not 1 to 1000 s, or as
    `require_sampling`. DataError: the robot cannot even stay near the middle of its range.
    """
    if not 1.0 <= duration <= _LONGEST:
        raise UsageError(
            f"duration {duration:g}: a random motion lasts 1 to {_LONGEST:g} s; design a longer "
            "one with idim-iv excite --for diagnosis"
        )
    require_sampling(rate, duration, "the random motion")
    model = load_model(configuration)
    limits = limits or motion_limits(model, configuration)
    random = np.random.default_rng(seed)
    joints = len(limits.lower)
    basis = FourierBasis(duration, round(_HIGHEST_FREQUENCY * duration))
    coefficients = random.normal(size=(basis.size, joints))
    posture = limits.middle + limits.half_range * random.uniform(-0.2, 0.2, joints)
    time = np.arange(round(duration * rate) + 1) / rate
    wave, slope, curve = basis.motion(time, coefficients)
    room = limits.room(posture)
    scale = np.minimum(room / np.abs(wave).max(axis=0), limits.velocity / np.abs(slope).max(axis=0))
    scale = np.minimum(scale, limits.acceleration / np.abs(curve).max(axis=0)) * limits.margin
    for _ in range(_ATTEMPTS):
        motion = Trajectory(
            tuple(model.robot.joints), rate, posture + scale * wave, scale * slope, scale * curve
        )
        if limit_use(model.robot, limits, motion).within(limits):
            return motion
        scale = _SHRINK * scale
    raise DataError(
        "no random motion keeps the torque limits: design one with idim-iv excite, or look at "
        "the effort limits of the URDF"
    )


def servo_motion(
    configuration: Configuration, limits: MotionLimits, *, rate: float, seed: int
) -> tuple[Trajectory, float, dict[str, object]]:
    """Return 20 s that show servos: a random motion as fast as its limits let it be.

    Reversals show dry friction and dead zone, accelerations armature and delay, and postures away
    from the middle the load that makes torques absolute.

    Returns the trajectory, its highest frequency in Hz, and its figures.
    """
    settings = {"rate": rate, "seed": seed}
    trajectory = random_motion(
        configuration, duration=_SERVO_SECONDS, rate=rate, seed=seed, limits=limits
    )
    robot = load_model(configuration).robot
    use = limit_use(robot, limits, trajectory)
    document = motion_document("servo", robot.name, trajectory, limits, use, settings)
    return trajectory, _HIGHEST_FREQUENCY, document
