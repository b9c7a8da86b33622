"""Link behind a shaft or a play, driven by the motor's measured motion.

M δ̈ = T(δ, δ̇) − τ − τ' δ: the link moves by δ against the motor, M its inertia about the joint, τ
the torque that it would need if it followed the motor, τ' its slope over the position (gravity), T
what the transmission gives.
"""

import numpy as np

from idim_iv_ros.compilation import entry
from idim_iv_ros.effects.motion import RobotMotion, Torques
from idim_iv_ros.types import FloatArray

_LEAST_INERTIA = 0.05  # of the largest along the motion
_STEPS_PER_PERIOD = 25.0  # of the transmission's natural frequency


def transmitted(
    motion: RobotMotion, joint: int, stiffness: float, damping: float, gap: float
) -> Torques:
    """Change of all torques (s, 1) by joint, against a rigid transmission.

    `stiffness`, `damping`: of the shaft or of the flanks, N m/rad, N m s/rad; `gap`: play, rad.
    """
    inertia = motion.inertia[:, :, joint]
    most = float(np.max(np.abs(inertia[:, joint]))) + 1e-12
    # That of an estimate may be negative.
    reflected = np.maximum(inertia[:, joint], _LEAST_INERTIA * most)
    frequency = np.sqrt(stiffness / float(np.min(reflected))) / (2.0 * np.pi)
    steps = max(1, int(np.ceil(_STEPS_PER_PERIOD * frequency / motion.rate)))
    steps += 1 - steps % 2  # odd, so that as many lie before a sample as after it
    slope = motion.slope(joint)
    response = np.empty((3, len(reflected)))
    _relative(
        np.ascontiguousarray(motion.load[:, joint]),
        np.ascontiguousarray(slope[:, joint]),
        np.ascontiguousarray(reflected),
        1.0 / motion.rate,
        stiffness,
        damping,
        0.5 * gap,
        steps,
        response,
    )
    torque, shift, acceleration = response
    changes = {
        other: (inertia[:, other] * acceleration + slope[:, other] * shift)[:, None]
        for other in range(inertia.shape[1])
    }
    changes[joint] = (torque - motion.load[:, joint])[:, None]
    return changes


@entry
def _relative(
    load: FloatArray,
    slope: FloatArray,
    inertia: FloatArray,
    step: float,
    stiffness: float,
    damping: float,
    half_gap: float,
    steps: int,
    response: FloatArray,
) -> None:
    """Write torque, shift and its acceleration, (3, s); starts in static equilibrium.

    Torque and acceleration are means from half a sample before to half a sample after. Each step
    waits for the one before it, so that what does not depend on the state is divided beforehand.
    """
    last = len(load) - 1
    side = 1.0 if load[0] >= 0.0 else -1.0
    shift = -load[0] / stiffness - side * half_gap
    speed = 0.0
    small = step / steps
    middle = (steps + 1) // 2 - 1
    torque, acceleration, count = 0.0, 0.0, 0
    for k in range(last + 1):
        response[1, k] = shift
        after = min(k + 1, last)
        for i in range(steps if k < last else 1):
            share = i / steps
            mass = (1.0 - share) * inertia[k] + share * inertia[after]
            followed = (1.0 - share) * load[k] + share * load[after]
            # Damping at the end of the step: it is stable however strong.
            carried = mass / (mass + small * damping)
            moved = small / (mass + small * damping)
            needed = followed + slope[k] * shift
            if half_gap == 0.0:
                later = carried * speed - moved * (stiffness * shift + needed)
                given = -stiffness * shift - damping * later
            else:
                bent = shift - min(max(shift, -half_gap), half_gap)
                later = carried * speed - moved * (stiffness * bent + needed)
                given = -stiffness * bent - damping * later
                # Flanks push and do not pull.
                if bent == 0.0 or given * bent > 0.0:
                    given = 0.0
                    later = speed - small * needed / mass
            torque += given
            acceleration += (given - needed) / mass
            count += 1
            speed = later
            shift += small * later
            if i == middle or k == last:
                response[0, k], response[2, k] = torque / count, acceleration / count
                torque, acceleration, count = 0.0, 0.0, 0
