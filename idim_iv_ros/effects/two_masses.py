"""Link behind a shaft or a play, driven by the motor's measured motion.

M δ̈ = T(δ, δ̇) − τ − τ' δ: the link moves by δ against the motor, M its inertia about the joint, τ
the torque that it would need if it followed the motor, τ' its slope over the position (gravity), T
what the transmission gives.
"""

import numpy as np
from numba import njit

from idim_iv_ros.effects.motion import RobotMotion
from idim_iv_ros.types import FloatArray

_LEAST_INERTIA = 0.05  # of the largest along the motion
_STEPS_PER_PERIOD = 25.0  # of the transmission's natural frequency


def transmitted(
    motion: RobotMotion, joint: int, stiffness: float, damping: float, gap: float
) -> dict[int, FloatArray]:
    """Change of all torques (s, 1) by joint, against a rigid transmission.

    Parameters
    ----------
    stiffness, damping
        N m/rad, N m s/rad, of the shaft or of the flanks.
    gap
        Play, rad.
    """
    inertia = motion.inertia[:, :, joint]
    most = float(np.max(np.abs(inertia[:, joint]))) + 1e-12
    own = np.maximum(inertia[:, joint], _LEAST_INERTIA * most)  # of an estimate, it may be negative
    frequency = np.sqrt(stiffness / float(np.min(own))) / (2.0 * np.pi)
    steps = max(1, int(np.ceil(_STEPS_PER_PERIOD * frequency / motion.rate)))
    steps += 1 - steps % 2  # odd, so that as many lie before a sample as after it
    slope = motion.slope(joint)
    torque, shift, acceleration = _relative(
        np.ascontiguousarray(motion.load[:, joint]),
        np.ascontiguousarray(slope[:, joint]),
        np.ascontiguousarray(own),
        1.0 / motion.rate,
        stiffness,
        damping,
        0.5 * gap,
        steps,
    )
    changes = {
        other: (inertia[:, other] * acceleration + slope[:, other] * shift)[:, None]
        for other in range(inertia.shape[1])
    }
    changes[joint] = (torque - motion.load[:, joint])[:, None]
    return changes


@njit(cache=True)
def _relative(
    load: FloatArray,
    slope: FloatArray,
    inertia: FloatArray,
    step: float,
    stiffness: float,
    damping: float,
    half_gap: float,
    steps: int,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Torque, shift and its acceleration, (s,) each; starts in static equilibrium.

    Torque and acceleration are means from half a sample before to half a sample after.
    """
    samples = len(load)
    torque, acceleration = np.zeros(samples), np.zeros(samples)
    counts = np.zeros(samples)
    moved = np.zeros(samples)
    side = 1.0 if load[0] >= 0.0 else -1.0
    shift = -load[0] / stiffness - side * half_gap
    speed = 0.0
    small = step / steps
    for k in range(samples):
        moved[k] = shift
        count = steps if k < samples - 1 else 1
        for i in range(count):
            share = i / steps
            after = min(k + 1, samples - 1)
            needed = (1.0 - share) * load[k] + share * load[after] + slope[k] * shift
            mass = (1.0 - share) * inertia[k] + share * inertia[after]
            bent = shift - min(max(shift, -half_gap), half_gap)
            given = 0.0
            if bent != 0.0 or half_gap == 0.0:
                # Damping at the end of the step: it is stable however strong.
                later = (speed - small * (stiffness * bent + needed) / mass) / (
                    1.0 + small * damping / mass
                )
                given = -stiffness * bent - damping * later
                if half_gap > 0.0 and given * bent > 0.0:  # flanks push and do not pull
                    given = 0.0
            change = (given - needed) / mass
            nearest = k if 2 * i < steps else after
            torque[nearest] += given
            acceleration[nearest] += change
            counts[nearest] += 1.0
            speed += small * change
            shift += small * speed
    return torque / counts, moved, acceleration / counts
