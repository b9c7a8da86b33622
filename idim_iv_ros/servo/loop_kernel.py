"""One joint behind a position servo, simulated over a whole recording (compiled).

Everything is divided by the stiffness K of the servo's loop, so that a command error of one radian
is a torque of one: what a recording without torques can tell is then linear in the parameters.
"""

import math
from typing import NamedTuple

from idim_iv_ros.compilation import entry, kernel
from idim_iv_ros.types import FloatArray

_SWEEPS = 6  # of the joints of a step, which begin where the step before ended


class Drive(NamedTuple):
    """Parameters of a servo and its loop, divided by its stiffness K."""

    compliance: float  # 1 / K, rad/(N m): what the rigid body's torques are multiplied with
    inertia: float  # Of the drive, s²
    damping: float  # Of loop, motor and bearings together, s
    friction: float  # Dry, rad: half the dead band
    offset: float  # rad
    delay: float  # From the command to its effect on the measured position, s
    limit: float  # Command error beyond which the torque grows no more, rad
    # Dry friction for each unit of the load, of gravity, Coriolis and other joints
    load_friction: float


# Columns of an array of drives.
_COMPLIANCE, _INERTIA, _DAMPING, _FRICTION = 0, 1, 2, 3
_OFFSET, _DELAY, _LIMIT, _LOAD_FRICTION = 4, 5, 6, 7


class Load(NamedTuple):
    """What the rigid bodies ask of joints along a motion, (n_samples, n_joints) each but `mass`."""

    mass: FloatArray  # (n_samples, n_joints, n_joints) kg m²
    torque: FloatArray  # N m, without the accelerations of these joints
    slope: FloatArray  # N m/rad, of that torque with the joint's position
    position: FloatArray  # rad, where torque and slope hold


@kernel
def mean_command(command: FloatArray, rate: float, start: float, duration: float) -> float:
    """Mean of a command, constant between samples, over `duration` s from `start` s.

    The duration is at most that of a sample.
    """
    last = command.shape[0] - 1
    first = min(max(math.floor(start * rate), 0), last)
    after = min(max(math.floor((start + duration) * rate), 0), last)
    if first == after:
        return float(command[first])
    share = (start + duration - after / rate) / duration
    return float((1.0 - share) * command[first] + share * command[after])


@kernel
def _rubbed(v: float, free: float, most: float) -> tuple[float, float]:
    """Speed after a step, and the share of the step after which the joint stopped (1: it did not).

    - `v`, `free`: speed before the step, and what it would be after it without dry friction
    - `most`: by how much dry friction can change it
    """
    if v == 0.0:
        return 0.0 if abs(free) <= most else free - math.copysign(most, free), 1.0
    after = free - math.copysign(most, v)
    if after * v >= 0.0 or most <= 0.0:
        return after, 1.0
    # It stops on the way, and sets off again if what pulls is enough.
    stop = v / (v - after)
    gained = free - v
    if abs(gained) <= most:
        return 0.0, stop
    return (1.0 - stop) * (gained - math.copysign(most, gained)), stop


@entry
def simulate_joints(
    drives: FloatArray,
    load: Load,
    command: FloatArray,
    rate: float,
    gain: float,
    steps: int,
    state: FloatArray,
    motion: FloatArray,
) -> None:
    """Follow the commands of a recording with joints that its mass matrix couples.

    The step is a midpoint rule, implicit in stiffness and damping: it is stable for any drive. A
    joint that stops stays until more than its dry friction pulls. Accelerations are found by
    projected Gauss-Seidel sweeps, which converge for every positive definite mass matrix.

    - `drives`: (n_joints, 8), rows as `Drive`; a compliance of zero leaves a joint without load
    - `load`: of n_samples instants
    - `command`: (n_samples, n_joints) rad at `rate` Hz, held from its sample to the next
    - `gain`: multiplies the command error before it saturates: 1 but where recordings of several
      gains are told apart by it
    - `steps`: in a sample
    - `state`: (6, n_joints) position, speed, and four rows of workspace; overwritten
    - `motion`: (2, n_samples, n_joints) position rad and speed rad/s, overwritten
    """
    mass, torque, slope, along = load
    q, v, change, pull = state[0], state[1], state[2], state[3]
    stop, dry = state[4], state[5]
    samples, joints = command.shape
    step = 1.0 / (rate * steps)
    for k in range(samples):
        for j in range(joints):
            motion[0, k, j] = q[j]
            motion[1, k, j] = v[j]
        if k == samples - 1:
            break
        for i in range(steps):
            w = (i + 0.5) / steps
            # What pulls each joint in the middle of the step, and its dry friction.
            for j in range(joints):
                asked = (1.0 - w) * torque[k, j] + w * torque[k + 1, j]
                bend = (1.0 - w) * slope[k, j] + w * slope[k + 1, j]
                there = (1.0 - w) * along[k, j] + w * along[k + 1, j]
                start = k / rate + i * step - drives[j, _DELAY]
                middle = q[j] + 0.5 * step * v[j]
                error = gain * (mean_command(command[:, j], rate, start, step) - middle)
                limit = drives[j, _LIMIT]
                pull[j] = min(max(error, -limit), limit) - drives[j, _OFFSET]
                pull[j] -= drives[j, _DAMPING] * v[j]
                carried = drives[j, _COMPLIANCE] * (asked + bend * (middle - there))
                pull[j] -= carried
                dry[j] = drives[j, _FRICTION] + drives[j, _LOAD_FRICTION] * abs(carried)
            # By how much their speeds change, each for the present changes of the others.
            for _ in range(_SWEEPS if joints > 1 else 1):
                for j in range(joints):
                    compliance, damping = drives[j, _COMPLIANCE], drives[j, _DAMPING]
                    others = 0.0
                    for other in range(joints):
                        if other != j:
                            others += mass[k, j, other] * change[other]
                    inertia = compliance * mass[k, j, j] + drives[j, _INERTIA]
                    inertia += 0.5 * step * damping
                    inertia += 0.25 * step**2 * gain
                    free = v[j] + (step * pull[j] - compliance * others) / inertia
                    after, stop[j] = _rubbed(v[j], free, step * dry[j] / inertia)
                    change[j] = after - v[j]
            for j in range(joints):
                after = v[j] + change[j]
                if stop[j] < 1.0:
                    q[j] += 0.5 * step * (stop[j] * v[j] + (1.0 - stop[j]) * after)
                else:
                    q[j] += 0.5 * step * (v[j] + after)
                v[j] = after
