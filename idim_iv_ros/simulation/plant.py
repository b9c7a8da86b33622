"""A robot's tree, dynamic parameters and friction as the arrays that compiled code works on."""

from typing import NamedTuple

import numpy as np

from idim_iv_ros.model import DynamicParameters, RobotModel
from idim_iv_ros.model.link_motion import LinkFrames, LinkMotion, empty_motion, link_frames
from idim_iv_ros.types import BoolArray, FloatArray, IntArray


class Contacts(NamedTuple):
    """Slip speeds, (n_contacts,) each, that dry friction opposes: of joints, then of couplings."""

    first: IntArray  # Joint from 0
    second: IntArray  # Joint whose speed is added; -1 for the friction of one joint
    direction: FloatArray  # 1, or -1 where the second speed is subtracted


class Plant(NamedTuple):
    """Kinematic tree with linear dynamic parameters and friction, joints in tree order."""

    frames: LinkFrames  # Each joint moves along or about the z of its own
    inertial: FloatArray  # (n + 1, 10): M, MX, MY, MZ, XX, XY, YY, XZ, YZ, ZZ in that frame
    drive_inertia: FloatArray  # (n, n): with the couplings off the diagonal
    damping: FloatArray  # likewise
    offset: FloatArray  # (n,)
    level: FloatArray  # (n_contacts,): dry friction, N m or N
    contacts: Contacts


class Workspace(NamedTuple):
    """Arrays that compiled code writes to, of a plant with n joints and c contacts."""

    motion: LinkMotion
    wrench: FloatArray  # (n + 1, 6)
    composite: FloatArray  # (n + 1, 10)
    mass: FloatArray  # (n, n)
    factor: FloatArray
    bias: FloatArray  # (n,)
    load: FloatArray
    response: FloatArray  # (c, n)
    schur: FloatArray  # (c, c)
    holding: FloatArray  # (c,)
    crossing: FloatArray
    independent: IntArray


class State(NamedTuple):
    """Where a simulation stands, and what it keeps from one instant to the next."""

    q: FloatArray  # (N,): of all coordinates, as the next six
    dq: FloatArray
    ddq: FloatArray  # of the last step
    middle: FloatArray  # position half a step ahead
    predicted: FloatArray  # velocity there
    spare: FloatArray  # a copy of the acceleration
    rest: FloatArray  # zeros
    integral: FloatArray  # (n,): of the control error, of the joints, as the next nine
    applied: FloatArray  # torque that has arrived
    acting: FloatArray  # the same with the disturbance
    before: FloatArray  # the same before this instant
    filtered: FloatArray  # output of the command's filter
    seen: FloatArray  # position at the last control instant
    speed: FloatArray  # that a law with a filter sees there
    fraction: FloatArray  # delay beyond whole periods, s
    whole: IntArray  # delay in whole control periods
    arrivals: IntArray  # commands that have arrived
    pending: FloatArray  # (ring, n): commands on their way
    resting: BoolArray  # (n_contacts,): see `dry_friction`, as the next two
    mode: IntArray
    spare_mode: IntArray


def initial_state(
    plant: Plant, q: FloatArray, dq: FloatArray, delay: FloatArray, period: float
) -> State:
    """State at the first instant: `q`, `dq` (N,) are taken over, not copied.

    `delay` (n,) is from a command to the torque, `period` between commands, s.
    """
    whole = np.floor(delay / period + 1e-6).astype(np.int64)
    fraction = np.maximum(delay - whole * period, 0.0)
    fraction[fraction < 1e-6 * period] = 0.0
    first, second, direction = plant.contacts
    slip = dq[first] + np.where(second >= 0, direction * dq[second], 0.0)
    mode, n = np.sign(slip).astype(np.int64), len(delay)
    resting, pending = (slip == 0.0) & (plant.level > 0.0), np.zeros((whole.max() + 2, n))
    numbers = (q, dq, *np.zeros((5, len(q))), *np.zeros((7, n)), fraction)
    counts = (whole, np.zeros_like(whole))
    return State._make([*numbers, *counts, pending, resting, mode, np.zeros_like(mode)])


def workspace(plant: Plant) -> Workspace:
    """Allocate the arrays for one plant."""
    n, contacts = len(plant.offset), len(plant.level)
    return Workspace._make(
        [
            empty_motion(n),
            np.zeros((n + 1, 6)),
            np.zeros((n + 1, 10)),
            *np.zeros((2, n, n)),
            *np.zeros((2, n)),
            np.zeros((contacts, n)),
            np.zeros((contacts, contacts)),
            *np.zeros((2, contacts)),
            np.zeros(contacts, dtype=np.int64),
        ]
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
    for joint, turned in enumerate(frames.turned[1:], start=1):
        mass, *first_moments, xx, xy, yy, xz, yz, zz = parameters.inertial[order[joint - 1]]
        inertia = turned.T @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ turned
        upper = inertia[(0, 0, 1, 0, 1, 2), (0, 1, 1, 2, 2, 2)]
        inertial[joint] = [mass, *turned.T @ first_moments, *upper]
    pairs = np.argsort(order)[parameters.coupling_joints.reshape(-1, 2)]
    first = np.concatenate([np.arange(n), pairs[:, 0]]).astype(np.int64)
    second = np.concatenate([np.full(n, -1), pairs[:, 1]]).astype(np.int64)
    level = np.concatenate([parameters.coulomb[order], parameters.coupling_coulomb])
    drive_inertia = np.diag(parameters.drive_inertia[order])
    viscous = parameters.viscous[order]
    damping = np.diag(np.maximum(viscous, 0.0) if dissipative else viscous)
    for pair, (a, b) in enumerate(zip(first[n:], second[n:], strict=True)):
        bound = np.sqrt(max(viscous[a], 0.0) * max(viscous[b], 0.0)) if dissipative else np.inf
        damping[a, b] = damping[b, a] = np.clip(parameters.coupling_viscous[pair], -bound, bound)
        drive_inertia[a, b] = drive_inertia[b, a] = parameters.coupling_inertia[pair]
    return Plant(
        frames=frames,
        inertial=inertial,
        drive_inertia=drive_inertia,
        damping=damping,
        offset=np.ascontiguousarray(parameters.offset[order], dtype=float),
        level=np.maximum(level, 0.0) if dissipative else level,
        contacts=Contacts(first, second, np.ones(len(first))),
    )
