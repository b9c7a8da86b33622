"""Sampled control law and plant in one loop over time (compiled).

Control, the arrival of its delayed command at the plant, and the recording each have their own
instants; the plant advances from one instant to the next in equal steps, so that the torque is
constant within every step whatever the three rates are.

The step is a midpoint rule of second order with one evaluation: positions drift half a step,
velocities are predicted there from the previous acceleration, viscous friction is implicit
(trapezoidal). A slip speed that would change its sign ends the step where it crosses zero; the
contact is then at rest, and the remainder of the step is integrated anew.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from idim_iv_ros.compilation import entry, kernel, source_digest
from idim_iv_ros.effects import registry
from idim_iv_ros.model import link_motion
from idim_iv_ros.model.link_motion import place_links
from idim_iv_ros.simulation import dry_friction, effect_kernel, rigid_body
from idim_iv_ros.simulation.dry_friction import accelerate, copy, factorise, slip
from idim_iv_ros.simulation.effect_kernel import Effects, acting_torque
from idim_iv_ros.simulation.plant import Plant, State, Workspace
from idim_iv_ros.simulation.rigid_body import composite_rigid_body, newton_euler
from idim_iv_ros.types import BoolArray, FloatArray, IntArray

TOGETHER = 1e-9  # Slip speeds that cross zero within this fraction of a step cross together


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
        return bool(factorise(work.mass, work.factor))
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
    effect_kernel.effect_torques(plant, effects, time, q, predicted, dq, mode, work.holding, step)
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
    return bool(factorise(work.mass, work.factor))


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
        if effects is not None and effect_kernel.states_turn(effects.rows, dq, ddq, left):
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
            effect_kernel.advance_states(effects.rows, dq, ddq, part)
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


COMPLETED, NOT_POSITIVE_DEFINITE, TOO_FAST = 0, 1, 2

SPEED_LIMIT = 1e3  # Speed (rad/s or m/s) above which a simulation has diverged


class Loop(NamedTuple):
    """Control law as one PID with feedforward, and instants of the loop; joints in tree order."""

    kp: FloatArray  # (n,), as the next three
    kd: FloatArray
    ki: FloatArray
    limit: FloatArray
    position: FloatArray  # (n_samples, n) at `rate`, as the next three
    velocity: FloatArray
    feedforward: FloatArray
    disturbance: FloatArray
    rate: float  # Hz
    period: float  # s
    delay: FloatArray  # (n,) s
    lag: FloatArray  # (n,) s
    plant_step: float  # s
    # Of the filter of differences that the law takes for the speed, 0 for the exact one
    speed_factor: float


class Trace(NamedTuple):
    """What the loop records, (n_samples, n) each; motion of the links behind shafts follows."""

    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray  # No rows where it is not asked for
    commanded: FloatArray
    applied: FloatArray


@kernel
def command(
    loop: Loop, time: float, q: FloatArray, dq: FloatArray, integral: FloatArray, out: FloatArray
) -> None:
    """Torque command at one control instant; references are interpolated linearly.

    The integral of a joint stands still while its torque is saturated and it would drive it
    further.
    """
    last = loop.position.shape[0] - 1
    place = min(max(time * loop.rate, 0.0), float(last))
    nearest = math.floor(place + 0.5)
    if abs(place - nearest) < 1e-6:
        place = nearest
    k = min(int(place), max(last - 1, 0))
    after = min(k + 1, last)
    w = place - k
    for i in range(q.shape[0]):
        error = (1.0 - w) * loop.position[k, i] + w * loop.position[after, i] - q[i]
        rate = (1.0 - w) * loop.velocity[k, i] + w * loop.velocity[after, i] - dq[i]
        feedforward = (1.0 - w) * loop.feedforward[k, i] + w * loop.feedforward[after, i]
        step = loop.period * error
        torque = loop.kp[i] * error + loop.kd[i] * rate + feedforward
        torque += loop.ki[i] * (integral[i] + step)
        if abs(torque) <= loop.limit[i] or torque * error < 0.0:
            integral[i] += step
        out[i] = min(max(torque, -loop.limit[i]), loop.limit[i])


@kernel
def _send(
    loop: Loop, state: State, time: float, controls: int, q: FloatArray, dq: FloatArray
) -> None:
    """Command of one control instant for what the encoders show, into the ring of pending ones."""
    row, filtered = state.pending[controls % state.pending.shape[0]], state.filtered
    if loop.speed_factor > 0.0:  # the law sees filtered differences of the positions
        for i in range(q.shape[0]):
            if controls == 0:
                state.speed[i] = dq[i]
            else:
                difference = (q[i] - state.seen[i]) / loop.period
                state.speed[i] += loop.speed_factor * (difference - state.speed[i])
            state.seen[i] = q[i]
        dq = state.speed
    command(loop, time, q, dq, state.integral, row)
    for i in range(row.shape[0]):
        if loop.lag[i] > 0.0:  # a filter of first order behind the law, from the first command on
            if controls == 0:
                filtered[i] = row[i]
            filtered[i] -= (row[i] - filtered[i]) * math.expm1(-loop.period / loop.lag[i])
            row[i] = filtered[i]


@kernel
def control(effects: Effects | None, loop: Loop, state: State, time: float, controls: int) -> None:
    """Command of one control instant, and what it does at the first."""
    row = state.pending[controls % state.pending.shape[0]]
    if effects is None:
        _send(loop, state, time, controls, state.q, state.dq)
    else:
        effect_kernel.measure(effects.rows, state.q, state.dq, effects.measured)
        _send(loop, state, time, controls, effects.measured[0], effects.measured[1])
    if controls == 0:
        for i in range(row.shape[0]):
            state.applied[i] = row[i] if effects is None else acting_torque(effects.rows, i, row[i])
            state.before[i] = state.applied[i] + loop.disturbance[0, i]


@kernel
def record(
    plant: Plant,
    effects: Effects | None,
    state: State,
    trace: Trace,
    time: float,
    recorded: int,
    row: FloatArray,
    work: Workspace,
) -> bool:
    """Record one sample; False if the mass matrix is not positive.

    Accelerations only where they are asked for: they cost as much as a step. With effects always,
    because the next step judges a joint at rest by the torque that held it here.
    """
    copy(state.q, trace.position[recorded])
    copy(state.dq, trace.velocity[recorded])
    copy(row, trace.commanded[recorded])
    for i in range(state.acting.shape[0]):
        trace.applied[recorded, i] = 0.5 * (state.before[i] + state.acting[i])
    if effects is None and recorded > 0 and trace.acceleration.shape[0] == 0:
        return True
    copy(state.mode, state.spare_mode)
    copy(state.ddq, state.spare)
    mean = trace.applied[recorded]
    # With effects twice: friction may depend on the load, and that on the acceleration.
    for _ in range(1 if effects is None else 2):
        q, dq, spare = state.q, state.dq, state.spare
        instant = (plant, effects, time, q, dq, state, spare, state.spare_mode, mean, 0.0, work)
        if not prepare(*instant):
            return False
        accelerate(plant, state.resting, state.spare_mode, work, state.spare)
    if recorded == 0:
        copy(state.spare, state.ddq)
    if trace.acceleration.shape[0] > 0:
        copy(state.spare, trace.acceleration[recorded])
    return True


def _entries(digest: str) -> tuple[Any, Any]:
    """Compile the functions that Python calls; `digest` is part of their key in numba's cache."""

    @entry
    def run(
        plant: Plant,
        effects: Effects | None,
        loop: Loop,
        state: State,
        trace: Trace,
        work: Workspace,
    ) -> tuple[int, int, int, float]:
        """Simulate from `state`, which is overwritten, until the `time` at which it ended.

        Returns outcome, joint, samples that were recorded before that time, time.
        """
        _ = digest
        n, ring, samples = loop.kp.shape[0], state.pending.shape[0], trace.position.shape[0]
        tolerance = 1e-9 * min(loop.period, 1.0 / loop.rate)
        # As literals the counts would have two types, and each function that takes them too.
        controls = recorded = int(np.int64(0))
        time = 0.0
        while True:
            copy(state.acting, state.before)
            if controls * loop.period <= time + tolerance:
                control(effects, loop, state, time, controls)
                controls += 1
            for i in range(n):
                if state.arrivals[i] * loop.period + state.fraction[i] <= time + tolerance:
                    arrived = max(state.arrivals[i] - state.whole[i], 0) % ring
                    state.applied[i] = state.pending[arrived, i]
                    if effects is not None:
                        state.applied[i] = acting_torque(effects.rows, i, state.applied[i])
                    state.arrivals[i] += 1
            sampled = recorded / loop.rate <= time + tolerance
            sample = recorded if sampled else recorded - 1
            for i in range(n):
                state.acting[i] = state.applied[i] + loop.disturbance[sample, i]
            if sampled:
                row = state.pending[(controls - 1) % ring]
                if not record(plant, effects, state, trace, time, recorded, row, work):
                    return NOT_POSITIVE_DEFINITE, 0, recorded, time
                recorded += 1
                if recorded == samples:
                    return COMPLETED, 0, recorded, time
            until = min(controls * loop.period, recorded / loop.rate)
            for i in range(n):
                until = min(until, state.arrivals[i] * loop.period + state.fraction[i])
            steps = max(math.ceil((until - time) / loop.plant_step - 1e-6), 1)
            for k in range(steps):
                start, step = time + k * (until - time) / steps, (until - time) / steps
                if not advance(plant, effects, start, state, step, work):
                    return NOT_POSITIVE_DEFINITE, 0, recorded, time
                for joint in range(state.dq.shape[0]):
                    if not abs(state.dq[joint]) < SPEED_LIMIT:
                        return TOO_FAST, joint, recorded, time + (k + 1) * (until - time) / steps
            time = until

    @entry
    def send(
        loop: Loop, state: State, controls: int, q: FloatArray, dq: FloatArray, sent: FloatArray
    ) -> None:
        """Write the command (n,) of a control instant for what the encoders show then."""
        _ = digest
        _send(loop, state, controls * loop.period, controls, q, dq)
        copy(state.pending[controls % state.pending.shape[0]], sent)

    return run, send


run_closed_loop, send_command = _entries(
    source_digest(link_motion, rigid_body, dry_friction, effect_kernel, *registry.MODULES)
)
