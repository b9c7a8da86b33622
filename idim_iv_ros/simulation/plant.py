"""A robot's tree, dynamic parameters and friction as the arrays that compiled code works on."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from idim_iv_ros.model.link_motion import LinkFrames, LinkMotion, empty_motion, link_frames
from idim_iv_ros.model.parameters import DynamicParameters
from idim_iv_ros.model.robot import RobotModel
from idim_iv_ros.types import FloatArray, IntArray


class Plant(NamedTuple):
    """Kinematic tree with linear dynamic parameters and friction, joints in tree order."""

    frames: LinkFrames  # Each joint moves along or about the z of its own
    inertial: FloatArray  # (n + 1, 10): M, MX, MY, MZ, XX, XY, YY, XZ, YZ, ZZ in that frame
    # drive_inertia, damping: (n, n): with the couplings off the diagonal
    drive_inertia: FloatArray
    damping: FloatArray
    offset: FloatArray  # (n,)
    level: FloatArray  # (n_contacts,): dry friction of each contact, N m or N
    # first, second: (n_contacts,): joints from 0 whose speeds are added; second is -1 for the
    # friction of one joint
    first: IntArray
    second: IntArray
    direction: FloatArray  # (n_contacts,): 1, or -1 where the second speed is subtracted


class Workspace(NamedTuple):
    """Arrays that compiled code writes to."""

    motion: LinkMotion
    wrench: FloatArray
    composite: FloatArray
    bias: FloatArray
    mass: FloatArray
    factor: FloatArray
    load: FloatArray
    response: FloatArray
    schur: FloatArray
    holding: FloatArray
    independent: IntArray
    crossing: FloatArray


class State(NamedTuple):
    """Where a simulation stands, and what it keeps from one instant to the next."""

    # q, dq, ddq: (N,): of all coordinates; the acceleration is that of the last step
    q: FloatArray
    dq: FloatArray
    ddq: FloatArray
    # middle, predicted, spare, rest: (N,): position and velocity half a step ahead; a copy of the
    # acceleration; zeros
    middle: FloatArray
    predicted: FloatArray
    spare: FloatArray
    rest: FloatArray
    # integral, applied, acting, before, filtered, fraction: (n,): of the joints: integral of the
    # control error, torque that has arrived, with the disturbance, the same before this instant,
    # output of the command's filter, delay beyond whole periods, s
    integral: FloatArray
    applied: FloatArray
    acting: FloatArray
    before: FloatArray
    filtered: FloatArray
    fraction: FloatArray
    # seen, speed: (n,): position at the last control instant, and the speed that a law with a
    # filter sees there
    seen: FloatArray
    speed: FloatArray
    # whole, arrivals: (n,): delay in whole control periods, commands that have arrived
    whole: IntArray
    arrivals: IntArray
    pending: FloatArray  # (ring, n): commands on their way
    # resting, mode, spare_mode: (n_contacts,): see `dry_friction`
    resting: NDArray[np.bool_]
    mode: IntArray
    spare_mode: IntArray


def initial_state(
    plant: Plant, q: FloatArray, dq: FloatArray, delay: FloatArray, period: float
) -> State:
    """State at the first instant.

    - `q`, `dq`: (N,), taken over, not copied
    - `delay`: (n,), from a command to the torque, s
    - `period`: between commands, s
    """
    whole = np.floor(delay / period + 1e-6).astype(np.int64)
    fraction = np.maximum(delay - whole * period, 0.0)
    fraction[fraction < 1e-6 * period] = 0.0
    slip = dq[plant.first] + np.where(plant.second >= 0, plant.direction * dq[plant.second], 0.0)
    n = len(delay)
    # In the order of the fields.
    values: list[Any] = [q, dq, *np.zeros((5, len(q))), *np.zeros((5, n)), fraction]
    values += [*np.zeros((2, n)), whole, np.zeros(n, dtype=np.int64)]
    values += [np.zeros((whole.max() + 2, n)), (slip == 0.0) & (plant.level > 0.0)]
    values += [np.sign(slip).astype(np.int64), np.zeros(len(slip), dtype=np.int64)]
    return State(*values)


def workspace(plant: Plant) -> Workspace:
    """Allocate the arrays for one plant."""
    n, contacts = len(plant.offset), len(plant.level)
    return Workspace(
        motion=empty_motion(n),
        wrench=np.zeros((n + 1, 6)),
        composite=np.zeros((n + 1, 10)),
        bias=np.zeros(n),
        mass=np.zeros((n, n)),
        factor=np.zeros((n, n)),
        load=np.zeros(n),
        response=np.zeros((contacts, n)),
        schur=np.zeros((contacts, contacts)),
        holding=np.zeros(contacts),
        independent=np.zeros(contacts, dtype=np.int64),
        crossing=np.zeros(contacts),
    )


def plant(robot: RobotModel, parameters: DynamicParameters, *, dissipative: bool = True) -> Plant:
    """Shape a robot and its parameters for simulation.

    - `parameters`: in the order of the robot's joints; they need not be physical
    - `dissipative`: clip friction at what dissipates: Fv, Fc and Fcm at zero, |Fvm| at √(Fv_a
      Fv_b). Estimates near zero are negative by their noise, and a joint that friction drives runs
      away.
    """
    order, frames = robot.order, link_frames(robot)
    n = len(order)
    inertial = np.zeros((n + 1, 10))
    for joint in range(1, n + 1):
        inertial[joint] = _in_frame(parameters.inertial[order[joint - 1]], frames.turned[joint])
    first, second, level = _contacts(parameters, order)
    drive_inertia = np.diag(parameters.drive_inertia[order])
    viscous = parameters.viscous[order]
    damping = np.diag(np.maximum(viscous, 0.0) if dissipative else viscous)
    for pair, (a, b) in enumerate(zip(first[n:], second[n:], strict=True)):
        bound = np.sqrt(max(viscous[a], 0.0) * max(viscous[b], 0.0)) if dissipative else np.inf
        coupling = np.clip(parameters.coupling_viscous[pair], -bound, bound)
        damping[a, b] = damping[b, a] = coupling
        drive_inertia[a, b] = drive_inertia[b, a] = parameters.coupling_inertia[pair]
    return Plant(
        frames=frames,
        inertial=inertial,
        drive_inertia=drive_inertia,
        damping=damping,
        offset=np.ascontiguousarray(parameters.offset[order], dtype=float),
        level=np.maximum(level, 0.0) if dissipative else level,
        first=first,
        second=second,
        direction=np.ones(len(first)),
    )


def _in_frame(inertial: FloatArray, frame: FloatArray) -> FloatArray:
    """Inertial parameters (10,) expressed in a frame turned by a rotation matrix."""
    xx, xy, yy, xz, yz, zz = inertial[4:]
    inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    inertia = frame.T @ inertia @ frame
    moments = frame.T @ inertial[1:4]
    upper = [inertia[0, 0], inertia[0, 1], inertia[1, 1], inertia[0, 2], inertia[1, 2]]
    return np.array([inertial[0], *moments, *upper, inertia[2, 2]])


def _contacts(
    parameters: DynamicParameters, order: IntArray
) -> tuple[IntArray, IntArray, FloatArray]:
    n = len(order)
    place = np.argsort(order)
    pairs = place[parameters.coupling_joints.reshape(-1, 2)]
    first = np.concatenate([np.arange(n), pairs[:, 0]]).astype(np.int64)
    second = np.concatenate([np.full(n, -1), pairs[:, 1]]).astype(np.int64)
    return first, second, np.concatenate([parameters.coulomb[order], parameters.coupling_coulomb])
