"""The closed loop with its signal chain, around either plant."""

from typing import NamedTuple

import numpy as np
from numba import njit, types
from numpy.typing import NDArray

from benchmarks.withheld_effects.control import (
    Controller,
    Course,
    delayed_command,
    filtered_command,
    limited_command,
)
from benchmarks.withheld_effects.drive import Drive
from benchmarks.withheld_effects.dry_friction import dry_level, sliding_torque
from benchmarks.withheld_effects.plant import RUNAWAY
from benchmarks.withheld_effects.plant_step import advance, at_rest

# Importing it loads MuJoCo's library, where compiled code finds mj_step.
from benchmarks.withheld_effects.rigid_body import mass_and_bias as _  # noqa: F401
from benchmarks.withheld_effects.transmission import encoder_error, link_torque, motor_torque

FloatArray = NDArray[np.float64]
_step = types.ExternalFunction("mj_step", types.void(types.intp, types.intp))


class Chain(NamedTuple):
    """Between plant and law.

    `factor` of the law's first-order speed filter, 0: the drive's own speed; `computing` s;
    `sampled` (n_joints,) s, when each joint is read and written after the start of the period.
    """

    factor: float
    computing: float
    sampled: FloatArray


class Recorded(NamedTuple):
    """What the loop leaves, (n_periods, n_joints) each.

    `position` rad and `speed` rad/s as the law has them; `command` N m; `applied` N m, the mean of
    what was sent to the drive over the period before the sample.
    """

    position: FloatArray
    speed: FloatArray
    command: FloatArray
    applied: FloatArray


@njit(cache=True)
def empty(periods: int, n: int) -> Recorded:
    """Nothing recorded yet."""
    a, b, c, d = np.zeros((4, periods, n))
    return Recorded(a, b, c, d)


@njit(cache=True)
def sense_and_command(
    drive: Drive,
    controller: Controller,
    chain: Chain,
    course: Course,
    resolution: np.ndarray,
    k: int,
    angle: np.ndarray,
    velocity: np.ndarray,
    recorded: Recorded,
    integral: np.ndarray,
    lagged: np.ndarray,
) -> None:
    """Row k: encoders, the law's speed, the command, and what the drive had meanwhile.

    `angle`, `velocity` (n_joints,) of the motors at the start of the period.
    """
    period = controller.period
    for j in range(len(angle)):
        # An encoder that is read later in the period has gone on.
        read = angle[j] + chain.sampled[j] * velocity[j]
        read += encoder_error(drive, j, read) + course.position_noise[k, j]
        if resolution[j] > 0.0:
            read = np.round(read / resolution[j]) * resolution[j]
        recorded.position[k, j] = read
        if chain.factor == 0.0:
            recorded.speed[k, j] = velocity[j] + course.velocity_noise[k, j]
        elif k > 0:
            difference = (read - recorded.position[k - 1, j]) / period
            before = recorded.speed[k - 1, j]
            recorded.speed[k, j] = before + chain.factor * (difference - before)
        wanted = controller.velocity_reference * course.velocity[k, j]
        command = limited_command(
            controller,
            j,
            course.position[k, j] - read,
            wanted - recorded.speed[k, j],
            course.feedforward[k, j],
            integral,
        )
        recorded.command[k, j] = filtered_command(controller, j, command, lagged, k == 0)
        begin = (k - 1) * period - chain.computing
        recorded.applied[k, j] = delayed_command(recorded.command, j, k, begin, period, period)


@njit(cache=True)
def stepped_in_time(
    addresses: tuple[int, int],
    views: tuple[np.ndarray, np.ndarray, np.ndarray],
    drive: Drive,
    controller: Controller,
    chain: Chain,
    course: Course,
    resolution: np.ndarray,
    heat: np.ndarray,
    substeps: int,
) -> tuple[Recorded, int]:
    """Close the loop around the plant of `withheld_effects`; see its `run`."""
    periods, n = course.position.shape
    period, step = controller.period, controller.period / substeps
    state = at_rest(drive, course.position[0], heat)
    recorded = empty(periods, n)
    integral, lagged, sent, angle, velocity = np.zeros((5, n))
    for k in range(periods):
        for j in range(n):
            angle[j] = state.position[state.motor[j]]
            velocity[j] = state.velocity[state.motor[j]]
            if not abs(velocity[j]) < RUNAWAY:
                return recorded, k
        sense_and_command(
            drive,
            controller,
            chain,
            course,
            resolution,
            k,
            angle,
            velocity,
            recorded,
            integral,
            lagged,
        )
        for s in range(substeps):
            for j in range(n):
                begin = k * period + s * step - drive.delay[j] - chain.computing - chain.sampled[j]
                sent[j] = delayed_command(recorded.command, j, k, begin, step, period)
            advance(addresses, views, drive, state, sent, course.external[k], step)
    return recorded, periods


@njit(cache=True)
def stepped_by_mujoco(
    addresses: tuple[int, int],
    state: tuple[np.ndarray, np.ndarray],
    inputs: tuple[np.ndarray, np.ndarray],
    losses: tuple[np.ndarray, np.ndarray],
    bias: np.ndarray,
    drive: Drive,
    controller: Controller,
    chain: Chain,
    course: Course,
    resolution: np.ndarray,
    heat: np.ndarray,
    substeps: int,
) -> tuple[Recorded, int]:
    """Close the loop around MuJoCo's mj_step.

    Dry friction is MuJoCo's frictionloss, a constraint of its solver, and viscous friction its
    damping; the torque goes through its actuators. Shafts, bristles and pairs are left out.

    Parameters
    ----------
    addresses
        Of mjModel and mjData.
    state
        Views of qpos and qvel, (n_joints,).
    inputs
        Views of ctrl and qfrc_applied, (n_joints,) N m.
    losses
        Views of dof_damping N m s/rad and dof_frictionloss N m, (n_joints,).
    bias
        View of qfrc_bias, (n_joints,) N m: gravity and Coriolis torque of the last step.
    """
    periods, n = course.position.shape
    period, step = controller.period, controller.period / substeps
    angle, velocity = state
    control, applied = inputs
    damping, loss = losses
    recorded = empty(periods, n)
    integral, lagged = np.zeros((2, n))
    for k in range(periods):
        for j in range(n):
            if not abs(velocity[j]) < RUNAWAY:
                return recorded, k
        sense_and_command(
            drive,
            controller,
            chain,
            course,
            resolution,
            k,
            angle,
            velocity,
            recorded,
            integral,
            lagged,
        )
        for s in range(substeps):
            for j in range(n):
                begin = k * period + s * step - drive.delay[j] - chain.computing - chain.sampled[j]
                sent = delayed_command(recorded.command, j, k, begin, step, period)
                torque = motor_torque(drive, j, sent, angle[j])
                viscous, drag = sliding_torque(drive, j, velocity[j], heat[j])
                forward = velocity[j] >= 0.0
                load = bias[j] if drive.load_static[j] > 0.0 else torque
                level = dry_level(drive, j, angle[j], velocity[j], load, heat[j], forward)
                control[j], damping[j], loss[j] = torque, viscous, level
                applied[j] = link_torque(drive, j, angle[j], velocity[j]) + drag
                applied[j] += course.external[k, j] - drive.offset[j]
                rate = (velocity[j] / drive.warm_speed[j]) ** 2 - heat[j]
                heat[j] += step * rate / drive.warm_time[j]
            _step(addresses[0], addresses[1])
    return recorded, periods
