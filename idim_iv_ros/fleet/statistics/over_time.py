"""What changed at each robot over time: steps and ramps of its bags' estimates."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from idim_iv_ros.fleet.statistics.multiplicity import FALSE_DISCOVERIES, choose
from idim_iv_ros.fleet.statistics.quantities import RobotBags
from idim_iv_ros.statistics.change_points import LEAST, Change, change_of
from idim_iv_ros.types import FloatArray

# Probability of so large a scatter beside a change, below which it is the robot's own.
_SCATTERS_MORE = 0.05


@dataclass(frozen=True)
class Series:
    """Estimates of one quantity of a robot over time, and the best supported change.

    Attributes
    ----------
    rows : (k,) int
        Bags of the robot that have an estimate and a time.
    change : Change or None
        None where nothing can be judged.
    """

    rows: NDArray[np.int64]
    change: Change | None


@dataclass(frozen=True)
class OverTime:
    """Outcome for one robot.

    Attributes
    ----------
    series : tuple of Series, one for each quantity
    changed : (m,) bool
        At the false discovery rate of the fleet.
    p_value : float
        Of the robot; NaN where nothing can be judged.
    """

    series: tuple[Series, ...]
    changed: NDArray[np.bool_]
    p_value: float


def over_time(
    robots: Sequence[tuple[RobotBags, FloatArray, FloatArray]], level: float = FALSE_DISCOVERIES
) -> list[OverTime]:
    """Search every robot and quantity for a change, at one false discovery rate.

    Parameters
    ----------
    robots : sequence of (RobotBags, (m,), (m,))
        With the variance between the bags of an unchanged robot, NaN where it is unknown, and the
        degrees of freedom by which other robots say it.
    """
    found = [_series(bags, between, prior) for bags, between, prior in robots]
    widest = max((len(each) for each in found), default=0)
    p_values = np.full((len(found), widest), np.nan)
    for row, each in enumerate(found):
        for column, series in enumerate(each):
            if series.change is not None:
                p_values[row, column] = series.change.p_value
    chosen = choose(p_values, level)
    return [
        OverTime(tuple(each), chosen.entries[row, : len(each)], float(chosen.p_values[row]))
        for row, each in enumerate(found)
    ]


def _series(robot: RobotBags, between: FloatArray, prior: FloatArray) -> list[Series]:
    dated = np.isfinite(robot.times)
    result = []
    for column in range(robot.values.shape[1]):
        values = robot.values[:, column]
        variances = robot.variances[:, column] + np.nan_to_num(between[column])
        rows = np.flatnonzero(dated & np.isfinite(values) & np.isfinite(variances))
        change = None
        if len(rows) >= LEAST:
            change = _change(values[rows], variances[rows], robot.times[rows], float(prior[column]))
        result.append(Series(rows, change))
    return result


def _change(
    values: FloatArray, variances: FloatArray, times: FloatArray, prior: float
) -> Change | None:
    """Search for a change; a robot that scatters more than others is judged by itself alone.

    A robot of which the model misses something differs from motion to motion, and what others
    scatter by would make changes of that.
    """
    change = change_of(values, variances, times, prior)
    if change is None or prior == 0.0:
        return change
    dof = len(values) - 2
    left = float(np.sum((values - change.fitted) ** 2 / variances))
    if scipy.stats.f.sf(left / dof, dof, prior) < _SCATTERS_MORE:
        return change_of(values, variances, times)
    return change
