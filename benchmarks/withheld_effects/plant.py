"""The true robot in closed loop: MuJoCo's rigid body, everything else integrated here."""

import numpy as np
from numba import njit

from benchmarks.withheld_effects.control import (
    Controller,
    Course,
    delayed_command,
    filtered_command,
    limited_command,
)
from benchmarks.withheld_effects.drive import Drive
from benchmarks.withheld_effects.plant_step import State, advance, at_rest
from benchmarks.withheld_effects.transmission import encoder_error

RUNAWAY = 60.0  # rad/s


@njit(cache=True)
def run(
    addresses: tuple[int, int],
    views: tuple[np.ndarray, np.ndarray, np.ndarray],
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
    addresses, views
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
    period, step = controller.period, controller.period / substeps
    state = at_rest(drive, course.position[0], heat)
    integral, lagged, sent = np.zeros((3, n))
    measured, speed, commands, link = np.zeros((4, periods, n))
    for k in range(periods):
        _sense(drive, state, course, resolution, k, measured, speed, link)
        for j in range(n):
            wanted = controller.velocity_reference * course.velocity[k, j]
            command = limited_command(
                controller,
                j,
                course.position[k, j] - measured[k, j],
                wanted - speed[k, j],
                course.feedforward[k, j],
                integral,
            )
            commands[k, j] = filtered_command(controller, j, command, lagged, k == 0)
            if not abs(state.velocity[j]) < RUNAWAY:
                return measured, speed, commands, link, k
        for s in range(substeps):
            now = k * period + s * step
            for j in range(n):
                sent[j] = delayed_command(commands, j, k, now - drive.delay[j], step, period)
            advance(addresses, views, drive, state, sent, course.external[k], step)
    return measured, speed, commands, link, periods


@njit(cache=True, forceinline=True)
def _sense(
    drive: Drive,
    state: State,
    course: Course,
    resolution: np.ndarray,
    k: int,
    measured: np.ndarray,
    speed: np.ndarray,
    link: np.ndarray,
) -> None:
    """Row k of what encoders and drives tell, and of the truth."""
    for j in range(len(state.motor)):
        m = state.motor[j]
        angle = state.position[m] + encoder_error(drive, j, state.position[m])
        angle += course.position_noise[k, j]
        if resolution[j] > 0.0:
            angle = np.round(angle / resolution[j]) * resolution[j]
        measured[k, j], link[k, j] = angle, state.position[j]
        speed[k, j] = state.velocity[m] + course.velocity_noise[k, j]
