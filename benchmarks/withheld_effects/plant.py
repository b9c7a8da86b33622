"""The true robot in closed loop: MuJoCo's rigid body, everything else integrated here."""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from benchmarks.withheld_effects.drive import Drive
from benchmarks.withheld_effects.dry_friction import bristle_share, dry_level, sliding_torque
from benchmarks.withheld_effects.rigid_body import mass_and_bias
from benchmarks.withheld_effects.sticking import inverse, stick_or_slip
from benchmarks.withheld_effects.transmission import (
    encoder_error,
    link_torque,
    motor_torque,
    shaft,
)

FloatArray = NDArray[np.float64]
RUNAWAY = 60.0  # rad/s


class Controller(NamedTuple):
    """tau = kp e + kd (dq_ref - dq) + ki ∫e + feedforward, limited; arrays (n_joints,)."""

    kp: FloatArray  # N m/rad
    kd: FloatArray  # N m s/rad
    ki: FloatArray  # N m/(rad s)
    limit: FloatArray  # N m
    lag: FloatArray  # s, first-order filter of the command; 0: none
    velocity_reference: float  # 1 or 0
    period: float  # s


class Course(NamedTuple):
    """What acts on the robot from outside, one row a control period, each (n_periods, n_joints)."""

    position: FloatArray  # reference, rad
    velocity: FloatArray  # reference, rad/s
    feedforward: FloatArray  # N m, added by the controller
    external: FloatArray  # N m, on the links
    position_noise: FloatArray  # rad
    velocity_noise: FloatArray  # rad/s


@njit(cache=True)
def _command(
    controller: Controller,
    j: int,
    error: float,
    speed_error: float,
    feedforward: float,
    integral: np.ndarray,
) -> float:
    wanted = controller.kp[j] * error + controller.kd[j] * speed_error + feedforward
    total = wanted + controller.ki[j] * (integral[j] + controller.period * error)
    if abs(total) < controller.limit[j]:
        integral[j] += controller.period * error
    else:
        total = wanted + controller.ki[j] * integral[j]
    return min(max(total, -controller.limit[j]), controller.limit[j])


@njit(cache=True)
def _delayed(
    commands: np.ndarray, j: int, k: int, start: float, step: float, period: float
) -> float:
    """Mean over a plant step of the held command that arrives from `start` on, N m."""
    first = int(np.floor(start / period + 1e-9))
    last = int(np.floor((start + step) / period - 1e-9))
    a, b = commands[max(first, 0), j], commands[min(max(last, 0), k), j]
    if first == last:
        return a
    share = (last * period - start) / step
    return share * a + (1.0 - share) * b


@njit(cache=True)
def run(
    addresses: tuple[int, int],
    state: tuple[np.ndarray, np.ndarray, np.ndarray],
    drive: Drive,
    controller: Controller,
    course: Course,
    resolution: np.ndarray,
    heat: np.ndarray,
    substeps: int,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, int]:
    """Simulate one recording; the plant takes `substeps` steps in a control period.

    Parameters
    ----------
    addresses, state
        Of MuJoCo's model and data, see `mass_and_bias`.
    resolution : (n_joints,) rad
        Of the encoders; 0: none.
    heat : (n_joints,)
        Where the warm-up stands, carried on in place.

    Returns
    -------
    measured, speed : (n_periods, n_joints) rad, rad/s
        What encoder and drive tell the controller at the start of each period.
    commands : (n_periods, n_joints) N m
        Held during the period.
    link : (n_periods, n_joints) rad
        True position of the links.
    done : int
        Periods before the robot ran away; n_periods if it did not.
    """
    periods, n = course.position.shape
    step = controller.period / substeps
    motor = np.arange(n)
    size = n
    for j in range(n):
        if drive.stiffness[j] > 0.0:
            motor[j] = size
            size += 1
    mass, bias = np.zeros((n, n)), np.zeros(n)
    effective, mobility = np.zeros((size, size)), np.zeros((size, size))
    x, v, old, middle, push = np.zeros((5, size))
    rows = n + 1
    direction, moved = np.zeros((rows, size)), np.zeros((rows, size))
    lower, upper, impulse = np.zeros(rows), np.zeros(rows), np.zeros(rows)
    for j in range(n):
        direction[j, motor[j]] = 1.0
        x[j] = x[motor[j]] = course.position[0, j]
    a, b = drive.pair
    direction[n, motor[a]] = 1.0
    direction[n, motor[b]] = drive.pair_ratio[0] if a != b else 1.0
    paired = drive.pair_dry[0] > 0.0 or drive.pair_viscous[0] != 0.0
    if not paired:
        rows = n
    bend = np.zeros(drive.bristle_weight.shape)
    integral, lagged = np.zeros(n), np.zeros(n)
    measured, speed, commands = np.zeros((3, periods, n))
    link = np.zeros((periods, n))
    for k in range(periods):
        for j in range(n):
            angle = x[motor[j]] + encoder_error(drive, j, x[motor[j]])
            angle += course.position_noise[k, j]
            if resolution[j] > 0.0:
                angle = np.round(angle / resolution[j]) * resolution[j]
            measured[k, j], link[k, j] = angle, x[j]
            speed[k, j] = v[motor[j]] + course.velocity_noise[k, j]
            wanted = controller.velocity_reference * course.velocity[k, j]
            commands[k, j] = _command(
                controller,
                j,
                course.position[k, j] - angle,
                wanted - speed[k, j],
                course.feedforward[k, j],
                integral,
            )
            if controller.lag[j] > 0.0:
                if k == 0:
                    lagged[j] = commands[k, j]
                lagged[j] += (commands[k, j] - lagged[j]) * (
                    1.0 - np.exp(-controller.period / controller.lag[j])
                )
                commands[k, j] = lagged[j]
            if not abs(v[j]) < RUNAWAY:
                return measured, speed, commands, link, k
        for s in range(substeps):
            now = k * controller.period + s * step
            for i in range(size):
                middle[i] = x[i] + 0.5 * step * v[i]
                old[i] = v[i]
            mass_and_bias(addresses[0], addresses[1], state, middle[:n], v[:n], mass, bias)
            effective[:] = 0.0
            effective[:n, :n] = mass
            for j in range(n):
                m = motor[j]
                sent = _delayed(commands, j, k, now - drive.delay[j], step, controller.period)
                torque = motor_torque(drive, j, sent, middle[m])
                effective[m, m] += drive.inertia[j]
                push[m] = 0.0
                push[j] = link_torque(drive, j, middle[j], v[j]) - bias[j] + course.external[k, j]
                viscous, drag = sliding_torque(drive, j, v[m], heat[j])
                forward = dry_level(drive, j, middle[m], v[m], torque, heat[j], True)
                backward = dry_level(drive, j, middle[m], v[m], torque, heat[j], False)
                lower[j], upper[j] = -step * forward, step * backward
                push[m] += torque - drive.offset[j] + drag - viscous * v[m]
                effective[m, m] += 0.5 * step * viscous
                if drive.bristle_travel[j] > 0.0:
                    lower[j] = upper[j] = 0.0
                    share = bristle_share(
                        bend[j],
                        drive.bristle_travel[j],
                        drive.bristle_span[j],
                        drive.bristle_weight[j],
                        step * v[m],
                    )
                    push[m] -= share * (forward if share > 0.0 else backward)
                if m != j:
                    carried, stiff, loss = shaft(drive, j, x[m] - x[j], v[m] - v[j])
                    # Linearised in the new velocities, so that stiff shafts stay stable.
                    carried += step * stiff * (v[m] - v[j])
                    slope = step * loss + step * step * stiff
                    push[j] += carried
                    push[m] -= carried
                    effective[j, j] += slope
                    effective[m, m] += slope
                    effective[j, m] -= slope
                    effective[m, j] -= slope
                rate = (v[m] / drive.warm_speed[j]) ** 2 - heat[j]
                heat[j] += step * rate / drive.warm_time[j]
            if paired:
                pair_speed = v[motor[a]] + drive.pair_ratio[0] * v[motor[b]]
                drag = (
                    -drive.pair_viscous[0]
                    * np.sign(pair_speed)
                    * abs(pair_speed) ** drive.pair_exponent[0]
                )
                push[motor[a]] += drag
                push[motor[b]] += drive.pair_ratio[0] * drag
                lower[n], upper[n] = -step * drive.pair_dry[0], step * drive.pair_dry[0]
            inverse(effective, mobility)
            for i in range(size):
                for r in range(size):
                    v[i] += step * mobility[i, r] * push[r]
            stick_or_slip(mobility, v, direction[:rows], lower[:rows], upper[:rows], impulse, moved)
            # A torque held during the step moves the joint like this exactly: no lag of half a step.
            for i in range(size):
                x[i] += 0.5 * step * (old[i] + v[i])
    return measured, speed, commands, link, periods
