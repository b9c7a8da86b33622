"""One time step of the plant: second order, with joints that stop, stick and break away (compiled).

The step is a midpoint rule with one evaluation: positions drift half a step, velocities are
predicted there from the previous acceleration, viscous friction is implicit (trapezoidal). A slip
speed that would change its sign ends the step where it crosses zero; the contact is then at rest,
and the remainder of the step is integrated anew.
"""

from idim_iv_ros.compilation import kernel
from idim_iv_ros.model.link_motion import place_links
from idim_iv_ros.simulation.dry_friction import accelerate, factorise, slip
from idim_iv_ros.simulation.effect_kernel import (
    Effects,
    advance_states,
    effect_torques,
    states_turn,
)
from idim_iv_ros.simulation.plant import Plant, State, Workspace
from idim_iv_ros.simulation.rigid_body import composite_rigid_body, newton_euler
from idim_iv_ros.types import BoolArray, FloatArray, IntArray

# Slip speeds that cross zero within this fraction of a step cross together.
TOGETHER = 1e-9


@kernel
def prepare(
    plant: Plant,
    effects: Effects | None,
    time: float,
    q: FloatArray,
    predicted: FloatArray,
    state: State,
    ddq: FloatArray,
    mode: IntArray,
    torque: FloatArray,
    step: float,
    work: Workspace,
) -> bool:
    """Factor of M + step/2 D, and torques without dry friction; False if M is not positive.

    `q` and `predicted` are the position and velocity at which the rigid bodies are evaluated, the
    state has the velocity at the start of the step. With effects also dry friction levels and
    damping are set: `ddq` is the last known acceleration, which the load of a joint is taken from.
    """
    dq = state.dq
    if effects is None:
        place_links(plant.frames, q, work.motion)
        newton_euler(plant, predicted, state.rest, work, work.bias)
        composite_rigid_body(plant, work, work.mass)
        for i in range(q.shape[0]):
            load = torque[i] - work.bias[i] - plant.offset[i]
            for j in range(q.shape[0]):
                load -= plant.damping[i, j] * dq[j]
                work.mass[i, j] += plant.drive_inertia[i, j] + 0.5 * step * plant.damping[i, j]
            work.load[i] = load
        positive: bool = factorise(work.mass, work.factor)
        return positive
    n = effects.link.shape[0]
    for i in range(n):
        effects.link_q[i] = q[effects.link[i]]
        effects.link_speed[i] = predicted[effects.link[i]]
    place_links(plant.frames, effects.link_q, work.motion)
    newton_euler(plant, effects.link_speed, effects.rest, work, work.bias)
    composite_rigid_body(plant, work, effects.rigid_mass)
    for i in range(n):
        effects.static[i] = effects.load[i] = work.bias[i]
        effects.inertial[i] = 0.0
        for j in range(n):
            effects.load[i] += effects.rigid_mass[i, j] * ddq[effects.link[j]]
            effects.inertial[i] += plant.drive_inertia[i, j] * ddq[j]
    effect_torques(plant, effects, time, q, predicted, dq, mode, work.holding, step)
    for i in range(q.shape[0]):
        load = -plant.offset[i] - effects.force[i]
        if i < n:
            load += torque[i]
        for j in range(q.shape[0]):
            load -= plant.damping[i, j] * dq[j]
            work.mass[i, j] = plant.drive_inertia[i, j] + effects.stiffness[i, j] * 0.25 * step**2
            work.mass[i, j] += 0.5 * step * plant.damping[i, j]
        work.load[i] = load
    for i in range(n):
        work.load[effects.link[i]] -= work.bias[i]
        for j in range(n):
            work.mass[effects.link[i], effects.link[j]] += effects.rigid_mass[i, j]
    positive = factorise(work.mass, work.factor)
    return positive


@kernel
def advance(
    plant: Plant, effects: Effects | None, time: float, state: State, step: float, work: Workspace
) -> bool:
    """Advance the state by one step under a constant torque; False if M is not positive.

    Without effects numba leaves out the branches of `effects`: there are two machine codes.
    `state.ddq` is the acceleration of the previous step on entry and of this one on return.
    """
    q, dq, ddq, torque, mode = state.q, state.dq, state.ddq, state.acting, state.mode
    middle, predicted = state.middle, state.predicted
    n, contacts, left = q.shape[0], mode.shape[0], step
    attempts = contacts + 4
    for attempt in range(attempts):
        for i in range(n):
            middle[i] = q[i] + 0.5 * left * dq[i]
            predicted[i] = dq[i] + 0.5 * left * ddq[i]
        instant = (plant, effects, time, middle, predicted, state, ddq, mode, torque, left, work)
        if not prepare(*instant):
            return False
        accelerate(plant, state.resting, mode, work, ddq)
        if effects is not None and states_turn(effects.rows, dq, ddq, left):
            prepare(*instant)
            accelerate(plant, state.resting, mode, work, ddq)
        fraction = _first_crossing(plant, state, left, work.crossing)
        if attempt == attempts - 1:
            fraction = 1.0
        for c in range(contacts):
            if state.resting[c]:
                state.resting[c] = mode[c] == 0 or slip(plant.contacts, c, ddq) == 0.0
            else:
                state.resting[c] = work.crossing[c] <= fraction + TOGETHER
        part = fraction * left
        if effects is not None:
            advance_states(effects.rows, dq, ddq, part)
        for i in range(n):
            q[i] += part * (dq[i] + 0.5 * part * ddq[i])
            dq[i] += part * ddq[i]
        _stop(plant, state.resting, dq)
        left -= part
        if left <= TOGETHER * step:
            break
    return True


@kernel
def _first_crossing(plant: Plant, state: State, step: float, crossing: FloatArray) -> float:
    """Fraction of the step at which the first slipping contact comes to rest, at most 1.

    `crossing` (n_contacts,) is set to the fraction of each; 2 if it does not.
    """
    fraction = 1.0
    for c in range(state.mode.shape[0]):
        crossing[c] = 2.0
        if state.resting[c] or plant.level[c] <= 0.0:
            continue
        sign = state.mode[c]
        start = sign * slip(plant.contacts, c, state.dq)
        end = start + step * sign * slip(plant.contacts, c, state.ddq)
        if start <= 0.0:
            crossing[c] = 0.0
        elif end <= 0.0:
            crossing[c] = start / (start - end)
        fraction = min(fraction, crossing[c])
    return fraction


@kernel
def _stop(plant: Plant, resting: BoolArray, dq: FloatArray) -> None:
    """Make the slip speeds at rest exactly zero."""
    n = dq.shape[0]
    for c in range(n):
        if resting[c]:
            dq[c] = 0.0
    for c in range(n, resting.shape[0]):
        if not resting[c]:
            continue
        a, b, sign = plant.contacts.first[c], plant.contacts.second[c], plant.contacts.direction[c]
        if resting[a]:
            dq[b] = 0.0
        elif resting[b]:
            dq[a] = 0.0
        else:  # both joints move: the nearest speeds that do not slip
            dq[b] = 0.5 * (dq[b] - sign * dq[a])
            dq[a] = -sign * dq[b]
