"""Sampled control law and plant in one loop over time (compiled).

Control, the arrival of its delayed command at the plant, and the recording each have their own
instants; the plant advances from one instant to the next in equal steps, so that the torque is
constant within every step whatever the three rates are.
"""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from idim_iv_ros.simulation import dry_friction, effect_kernel, plant_step, rigid_body
from idim_iv_ros.simulation.compilation import entry, kernel, source_digest
from idim_iv_ros.simulation.dry_friction import accelerate, slip
from idim_iv_ros.simulation.effect_kernel import Effects, acting_torque, measure
from idim_iv_ros.simulation.plant import FloatArray, IntArray, Plant, Workspace
from idim_iv_ros.simulation.plant_step import advance, prepare, prepare_with_effects

COMPLETED, NOT_POSITIVE_DEFINITE, TOO_FAST = 0, 1, 2

# Speed (rad/s or m/s) above which a simulation has diverged.
SPEED_LIMIT = 1e3


class Loop(NamedTuple):
    """Control law as one PID with feedforward, and the instants of the loop.

    kp, kd, ki, limit : (n,); position, velocity, feedforward, disturbance : (n_samples, n) at
    `rate` (Hz); delay, lag : (n,) s; period, plant_step : s. Joints in tree order.
    """

    kp: FloatArray
    kd: FloatArray
    ki: FloatArray
    limit: FloatArray
    position: FloatArray
    velocity: FloatArray
    feedforward: FloatArray
    disturbance: FloatArray
    rate: float
    period: float
    delay: FloatArray
    lag: FloatArray
    plant_step: float


class Trace(NamedTuple):
    """What the loop records, (n_samples, n) each; motion of the links behind shafts follows."""

    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
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
def filter_command(loop: Loop, first: bool, filtered: FloatArray, out: FloatArray) -> None:
    """Put the command behind the first-order filter of those joints that have one.

    `filtered` (n,) is the filter's state; it starts at the first command.
    """
    for i in range(out.shape[0]):
        if loop.lag[i] > 0.0:
            if first:
                filtered[i] = out[i]
            filtered[i] -= (out[i] - filtered[i]) * math.expm1(-loop.period / loop.lag[i])
            out[i] = filtered[i]


@kernel
def too_fast(dq: FloatArray) -> int:
    """Joint whose speed is not below the limit, or -1."""
    for i in range(dq.shape[0]):
        if not abs(dq[i]) < SPEED_LIMIT:
            return i
    return -1


def _entry(digest: str) -> Callable[..., Any]:
    """Compile the function that Python calls; `digest` is part of its key in numba's cache."""

    @entry
    def run(
        plant: Plant,
        effects: Effects | None,
        loop: Loop,
        q: FloatArray,
        dq: FloatArray,
        trace: Trace,
        work: Workspace,
    ) -> tuple[int, int, int, float]:
        """Simulate; q and dq are the initial state and are overwritten.

        Returns
        -------
        outcome, joint, samples, time
            Samples are those that were recorded before the time at which it ended.
        """
        _ = digest
        n, coordinates = loop.kp.shape[0], q.shape[0]
        samples = trace.position.shape[0]
        tolerance = 1e-9 * min(loop.period, 1.0 / loop.rate)
        whole, fraction = np.zeros(n, np.int64), np.zeros(n)
        for i in range(n):
            whole[i] = math.floor(loop.delay[i] / loop.period + 1e-6)
            fraction[i] = max(loop.delay[i] - whole[i] * loop.period, 0.0)
            if fraction[i] < 1e-6 * loop.period:
                fraction[i] = 0.0
        ring = whole.max() + 2
        pending = np.zeros((ring, n))
        resting, mode, spare_mode = first_modes(plant, dq)
        integral, applied, acting = np.zeros(n), np.zeros(n), np.zeros(n)
        before, mean, filtered = np.zeros(n), np.zeros(n), np.zeros(n)
        ddq, spare, rest = np.zeros(coordinates), np.zeros(coordinates), np.zeros(coordinates)
        middle, predicted = np.zeros(coordinates), np.zeros(coordinates)
        arrivals = np.zeros(n, np.int64)
        controls = recorded = 0
        time = 0.0
        while True:
            before[:] = acting
            if controls * loop.period <= time + tolerance:
                row = controls % ring
                if effects is None:
                    command(loop, time, q, dq, integral, pending[row])
                else:
                    measure(effects, q, dq)
                    command(
                        loop, time, effects.measured[0], effects.measured[1], integral, pending[row]
                    )
                    filter_command(loop, controls == 0, filtered, pending[row])
                if controls == 0:
                    for i in range(n):
                        applied[i] = pending[0, i]
                        if effects is not None:
                            applied[i] = acting_torque(effects, i, applied[i])
                    before[:] = applied + loop.disturbance[0]
                controls += 1
            for i in range(n):
                if arrivals[i] * loop.period + fraction[i] <= time + tolerance:
                    applied[i] = pending[max(arrivals[i] - whole[i], 0) % ring, i]
                    if effects is not None:
                        applied[i] = acting_torque(effects, i, applied[i])
                    arrivals[i] += 1
            sampled = recorded / loop.rate <= time + tolerance
            sample = recorded if sampled else recorded - 1
            for i in range(n):
                acting[i] = applied[i] + loop.disturbance[sample, i]
            if sampled:
                for i in range(n):
                    mean[i] = 0.5 * (before[i] + acting[i])
                spare_mode[:] = mode
                spare[:] = ddq
                # With effects twice: friction may depend on the load, and that on the acceleration.
                for _ in range(1 if effects is None else 2):
                    if effects is None:
                        positive = prepare(plant, q, dq, dq, rest, mean, 0.0, work)
                    else:
                        positive = prepare_with_effects(
                            plant, effects, time, q, dq, dq, spare, spare_mode, mean, 0.0, work
                        )
                    if not positive:
                        return NOT_POSITIVE_DEFINITE, 0, recorded, time
                    accelerate(plant, resting, spare_mode, work, spare)
                if recorded == 0:
                    ddq[:] = spare
                trace.position[recorded] = q
                trace.velocity[recorded] = dq
                trace.acceleration[recorded] = spare
                trace.commanded[recorded] = pending[(controls - 1) % ring]
                trace.applied[recorded] = mean
                recorded += 1
                if recorded == samples:
                    return COMPLETED, 0, recorded, time
            until = min(controls * loop.period, recorded / loop.rate)
            for i in range(n):
                until = min(until, arrivals[i] * loop.period + fraction[i])
            steps = max(math.ceil((until - time) / loop.plant_step - 1e-6), 1)
            for k in range(steps):
                if not advance(
                    plant, effects, time + k * (until - time) / steps,
                    q, dq, ddq, acting, (until - time) / steps,
                    resting, mode, middle, predicted, rest, work,
                ):  # fmt: skip
                    return NOT_POSITIVE_DEFINITE, 0, recorded, time
                joint = too_fast(dq)
                if joint >= 0:
                    return TOO_FAST, joint, recorded, time + (k + 1) * (until - time) / steps
            time = until

    compiled: Callable[..., Any] = run
    return compiled


@kernel
def first_modes(plant: Plant, dq: FloatArray) -> tuple[NDArray[np.bool_], IntArray, IntArray]:
    """Which contacts are at rest at the start, and the sign of the slip of the others."""
    contacts = plant.level.shape[0]
    resting = np.zeros(contacts, np.bool_)
    mode = np.zeros(contacts, np.int64)
    for c in range(contacts):
        speed = slip(plant.first, plant.second, plant.direction, c, dq)
        resting[c] = speed == 0.0 and plant.level[c] > 0.0
        mode[c] = 1 if speed > 0.0 else -1 if speed < 0.0 else 0
    return resting, mode, mode.copy()


run_closed_loop = _entry(source_digest(rigid_body, dry_friction, effect_kernel, plant_step))
