"""How one recording differs from others of the same servo: its gain, or the load that it moved."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import scipy

from idim_iv_ros.servo.fit import (
    DIFFERENCE,
    DriveEstimate,
    Run,
    block_covariance,
    residuals,
    used_labels,
)
from idim_iv_ros.servo.loop_kernel import Drive, Load
from idim_iv_ros.types import FloatArray


def fit_factor(run: Run, answer: DriveEstimate, what: str) -> tuple[float, float]:
    """Factor of the gain or of the load of one run that suits a drive found on others.

    Parameters
    ----------
    what
        ``gain`` or ``load``.

    Returns
    -------
    factor, standard deviation
        With what is not sure of the drive, and blocks that differ.
    """

    def residual(factor: float, drive: Drive) -> FloatArray:
        other = scaled(run, factor, what)
        return residuals([other], drive)

    solution = scipy.optimize.least_squares(
        lambda x: residual(float(x[0]), answer.drive), [1.0], bounds=(0.01, 100.0), x_scale="jac"
    )
    factor = float(solution.x[0])
    slope = _slope(lambda x: residual(x, answer.drive), factor, DIFFERENCE)
    scatter, _ = block_covariance(used_labels([run]), solution.fun, slope[:, None])
    variance = float(scatter[0, 0])
    bread = float(slope @ slope)
    values, spread = np.array(answer.drive), np.sqrt(np.diag(answer.covariance))
    change = np.zeros(len(values))
    for k in np.flatnonzero(spread > 0.0):

        def moved(value: float, k: int = int(k)) -> FloatArray:
            drive = values.copy()
            drive[k] = value
            return residual(factor, Drive(*drive))

        column = _slope(
            moved, float(values[k]), min(0.1 * float(spread[k]), 0.5 * values[k] + 1e-6)
        )
        change[k] = -float(slope @ column) / bread
    return factor, float(np.sqrt(variance + change @ answer.covariance @ change))


def scaled(run: Run, factor: float, what: str) -> Run:
    """Return a run whose gain or load is multiplied."""
    if what == "gain":
        return replace(run, gain=factor * run.gain)
    inertia, torque, slope = (factor * values for values in run.load[:3])
    return replace(run, load=Load(inertia, torque, slope, run.load.position))


def _slope(function: Callable[[float], FloatArray], at: float, step: float) -> FloatArray:
    return (function(at + step) - function(at - step)) / (2.0 * step)
