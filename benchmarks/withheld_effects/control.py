"""The controller of the true robot, and what it is told of the motion."""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


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
def limited_command(
    controller: Controller,
    j: int,
    error: float,
    speed_error: float,
    feedforward: float,
    integral: np.ndarray,
) -> float:
    """Command of joint j, N m; `integral` (n_joints,) rad s stands still in saturation."""
    wanted = controller.kp[j] * error + controller.kd[j] * speed_error + feedforward
    total = wanted + controller.ki[j] * (integral[j] + controller.period * error)
    if abs(total) < controller.limit[j]:
        integral[j] += controller.period * error
    else:
        total = wanted + controller.ki[j] * integral[j]
    return min(max(total, -controller.limit[j]), controller.limit[j])


@njit(cache=True)
def filtered_command(
    controller: Controller, j: int, command: float, lagged: np.ndarray, first: bool
) -> float:
    """Command behind its first-order filter, N m; `lagged` (n_joints,) is the filter's state."""
    if controller.lag[j] == 0.0:
        return command
    if first:
        lagged[j] = command
    lagged[j] += (command - lagged[j]) * (1.0 - np.exp(-controller.period / controller.lag[j]))
    return lagged[j]


@njit(cache=True)
def delayed_command(
    commands: np.ndarray, j: int, k: int, start: float, step: float, period: float
) -> float:
    """Mean over a plant step of the held command that arrives from `start` (s) on, N m.

    `commands` (n_periods, n_joints) is known up to row `k`.
    """
    first = int(np.floor(start / period + 1e-9))
    last = int(np.floor((start + step) / period - 1e-9))
    a, b = commands[max(first, 0), j], commands[min(max(last, 0), k), j]
    if first == last:
        return a
    share = (last * period - start) / step
    return share * a + (1.0 - share) * b
