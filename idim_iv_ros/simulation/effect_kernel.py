"""What effects do to a robot beyond rigid bodies and linear friction (compiled).

The laws are those that the files of `effects/` declare; here is when they are asked and where
their torques go.

Coordinates are the n motors in tree order, then the links behind those that have a shaft (a joint
without shaft moves its link itself). Friction, offsets, springs and ripple act on the motors.
All that opposes motion becomes a dry friction level or a damping of this instant, so that the
joint sticks and breaks away as under Coulomb friction; stiff terms enter the step implicitly.
"""

from typing import NamedTuple

import numpy as np

from idim_iv_ros.compilation import dispatcher, kernel
from idim_iv_ros.effects.contribution import LEAST_SPEED, Instant, Load, Torque
from idim_iv_ros.effects.registry import DRIVE_LAWS, ENCODER_LAWS, TORQUE_LAWS
from idim_iv_ros.simulation.dry_friction import copy, slip
from idim_iv_ros.simulation.plant import Plant
from idim_iv_ros.types import BoolArray, FloatArray, IntArray

# Dry friction of a joint whose effects leave none at this instant, N m: it can still stick.
LEAST_LEVEL = 1e-9

_torque = dispatcher({kind: law.torque for kind, law in enumerate(TORQUE_LAWS)}, "p, at, state")
_STATEFUL = {kind: law for kind, law in enumerate(TORQUE_LAWS) if law.advance is not None}
_moves = {kind: law.advance for kind, law in _STATEFUL.items() if law.advance is not None}
_advance = dispatcher(_moves, "p, state, dq, ddq, step")
_turns = dispatcher({kind: law.turns for kind, law in _STATEFUL.items()}, "p, state, dq, ddq, step")
_curve = dispatcher({kind: law.curve for kind, law in enumerate(DRIVE_LAWS)}, "p, command")
_error = dispatcher({kind: law.error for kind, law in enumerate(ENCODER_LAWS)}, "p, q")


class Rows(NamedTuple):
    """Contributions with compiled laws: t torques first, then drive curves, then encoder errors."""

    kind: IntArray  # (rows,): law
    joint: IntArray  # (rows,): in tree order; of a coupling its contact
    value: FloatArray  # (rows, most values): of the law
    load: IntArray  # (rows,): what a torque takes as the load (`contribution.Load`)
    state: FloatArray  # (t, STATES)
    stateful: IntArray  # (torques with a state,): their rows
    first_error: int  # Row of the first encoder error


class Effects(NamedTuple):
    """Effects of one robot as arrays, n joints, N coordinates."""

    rows: Rows
    # (n_contacts,): dry friction without effects, less what they take the place of
    level: FloatArray
    damping: FloatArray  # (N, N): viscous friction without effects
    model_level: FloatArray  # (n_contacts,): dry friction of the model, all of it
    dry: BoolArray  # (n_contacts,): joints and couplings with dry friction at any time
    dissipative: BoolArray  # (n,): joints whose friction is kept from driving
    start_time: float  # s since the start of the session
    link: IntArray  # (n,): coordinates of the links
    shaft_joint: IntArray  # (N - n,)
    shaft: FloatArray  # (N - n, 3): gap, stiffness and damping
    force: FloatArray  # (N,): written by compiled code, as all that follow
    stiffness: FloatArray
    link_q: FloatArray  # (n,), as the next five
    link_speed: FloatArray
    rest: FloatArray
    load: FloatArray  # torque of the links
    static: FloatArray  # the same without accelerations
    inertial: FloatArray  # torque of the drives' inertia
    rigid_mass: FloatArray
    measured: FloatArray


@kernel
def acting_torque(rows: Rows, joint: int, command: float) -> float:
    """Torque of the motor for a command."""
    for row in range(rows.state.shape[0], rows.first_error):
        if rows.joint[row] == joint:
            command = _curve(rows.kind[row], rows.value[row], command)
    return command


@kernel
def measure(rows: Rows, q: FloatArray, dq: FloatArray, measured: FloatArray) -> None:
    """Position and velocity of the motors as the encoders show them, into `measured` (2, n)."""
    for i in range(measured.shape[1]):
        measured[0, i] = q[i]
        measured[1, i] = dq[i]
    for row in range(rows.first_error, rows.kind.shape[0]):
        i = rows.joint[row]
        error, slope = _error(rows.kind[row], rows.value[row], q[i])
        measured[0, i] += error
        measured[1, i] += dq[i] * slope


@kernel
def advance_states(rows: Rows, dq: FloatArray, ddq: FloatArray, step: float) -> None:
    """Move the states of effects along one step that starts at dq."""
    for k in range(rows.stateful.shape[0]):
        t = rows.stateful[k]
        i = rows.joint[t]
        _advance(rows.kind[t], rows.value[t], rows.state[t], dq[i], ddq[i], step)


@kernel
def states_turn(rows: Rows, dq: FloatArray, ddq: FloatArray, step: float) -> bool:
    """Whether a state turns within this step into another regime, which is then set.

    The step is to be computed anew.
    """
    changed = False
    for k in range(rows.stateful.shape[0]):
        t = rows.stateful[k]
        i = rows.joint[t]
        if _turns(rows.kind[t], rows.value[t], rows.state[t], dq[i], ddq[i], step):
            changed = True
    return changed


@kernel
def effect_torques(
    plant: Plant,
    effects: Effects,
    time: float,
    q: FloatArray,
    speed: FloatArray,
    dq: FloatArray,
    mode: IntArray,
    holding: FloatArray,
    step: float,
) -> None:
    """Set the plant's dry friction and damping, and force and stiffness of the effects.

    `q`, `speed` are half a step ahead, `dq` is the velocity at the start. A joint at rest is
    judged by the direction in which the last step's torque would move it (`holding`).
    """
    copy(effects.level, plant.level)
    for i in range(effects.force.shape[0]):
        effects.force[i] = 0.0
        for j in range(effects.force.shape[0]):
            plant.damping[i, j] = effects.damping[i, j]
            effects.stiffness[i, j] = 0.0
    rows, n = effects.rows, effects.link.shape[0]
    for t in range(rows.state.shape[0]):
        c = rows.joint[t]
        w = slip(plant.contacts, c, speed)
        if effects.dry[c] and (mode[c] != 0 or c >= n):
            sign = float(mode[c])
        else:
            sign = np.sign(holding[c] if effects.dry[c] else w)
        position = velocity = load = 0.0
        if c < n:
            position, velocity, load = q[c], dq[c], effects.load[c]
            if rows.load[t] == Load.STATIC:
                load = effects.static[c]
            elif rows.load[t] == Load.MOTOR:
                load += _drive_torque(plant, effects, c, sign, speed, mode, holding)
        now = effects.start_time + time
        at = Instant(now, time, position, max(sign * w, 0.0), sign, load, velocity, step)
        torque: Torque = _torque(rows.kind[t], rows.value[t], at, rows.state[t])
        plant.level[c] += torque.level
        if c < n:
            plant.damping[c, c] += torque.damping
            effects.force[c] += torque.force
            effects.stiffness[c, c] += torque.stiffness
        else:
            a, b = plant.contacts.first[c], plant.contacts.second[c]
            plant.damping[a, a] += torque.damping
            plant.damping[b, b] += torque.damping
            plant.damping[a, b] += plant.contacts.direction[c] * torque.damping
            plant.damping[b, a] += plant.contacts.direction[c] * torque.damping
    for c in range(effects.level.shape[0]):
        if effects.dry[c]:
            plant.level[c] = max(plant.level[c], LEAST_LEVEL)
    for i in range(n):
        if effects.dissipative[i]:
            bound = -max(plant.level[i], 0.0) / max(abs(speed[i]), LEAST_SPEED)
            plant.damping[i, i] = max(plant.damping[i, i], bound)
    for k in range(effects.shaft_joint.shape[0]):
        _twist(plant, effects, k, q, dq)


@kernel
def _drive_torque(
    plant: Plant,
    effects: Effects,
    joint: int,
    sign: float,
    speed: FloatArray,
    mode: IntArray,
    holding: FloatArray,
) -> float:
    """What the model adds to the load of the links: drives, friction and offset, no effects.

    `sign`: direction in which the joint moves, or would.
    """
    total: float = plant.offset[joint] + effects.inertial[joint] + sign * effects.model_level[joint]
    for j in range(speed.shape[0]):
        total += effects.damping[joint, j] * speed[j]
    for c in range(speed.shape[0], mode.shape[0]):
        level = effects.model_level[c]
        friction = mode[c] * level if mode[c] != 0 else min(max(holding[c], -level), level)
        if plant.contacts.first[c] == joint:
            total += friction
        elif plant.contacts.second[c] == joint:
            total += plant.contacts.direction[c] * friction
    return total


@kernel
def _twist(plant: Plant, effects: Effects, k: int, q: FloatArray, dq: FloatArray) -> None:
    """Torque of one shaft on its motor and its link; flanks only push."""
    motor, link = effects.shaft_joint[k], effects.link.shape[0] + k
    twist, rate = q[motor] - q[link], dq[motor] - dq[link]
    half, stiffness, damping = 0.5 * effects.shaft[k, 0], effects.shaft[k, 1], effects.shaft[k, 2]
    if half > 0.0:
        side = 1.0 if twist > 0.0 else -1.0
        twist -= side * half
        if side * twist <= 0.0 or side * (stiffness * twist + damping * rate) <= 0.0:
            return
    effects.force[motor] += stiffness * twist
    effects.force[link] -= stiffness * twist
    for row in (motor, link):
        for column in (motor, link):
            sign = 1.0 if row == column else -1.0
            effects.stiffness[row, column] += sign * stiffness
            plant.damping[row, column] += sign * damping
