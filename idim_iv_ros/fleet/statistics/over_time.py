"""What changed at each robot over time: steps and ramps of its bags' estimates.

The search for changes takes bags of an unchanged robot for independent. Where temperature or season
move the parameters slowly they are not, and slow movements pass for changes: `resemblance` says so.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from idim_iv_ros.fleet.statistics.outliers import choose
from idim_iv_ros.fleet.statistics.quantities import RobotBags
from idim_iv_ros.statistics.change_points import LEAST, Change, change_of
from idim_iv_ros.types import FloatArray

# Probability of so large a scatter around a change, below which only the robot's bags say it.
_SCATTERS_MORE = 0.05


@dataclass(frozen=True)
class OverTime:
    """What changed over time at one robot, in m quantities."""

    rows: Sequence[NDArray[np.int64]]  # by quantity, the bags that have an estimate and a time
    changes: Sequence[Change | None]  # the best supported ones; None where none can be judged
    changed: NDArray[np.bool_]  # (m,), at the false discovery rate of the fleet
    p_value: float  # of the robot; NaN where nothing can be judged


def over_time(robots: Sequence[tuple[RobotBags, FloatArray, FloatArray]]) -> list[OverTime]:
    """Search every robot and quantity for a change, at one false discovery rate.

    Each robot comes with the variance (m,) between the bags of an unchanged robot, NaN where it is
    unknown, and the degrees of freedom (m,) by which other robots say it.
    """
    series = []
    for bags, between, prior in robots:
        variances = bags.variances + np.nan_to_num(between)
        usable = np.isfinite(bags.times)[:, None] & np.isfinite(bags.values + variances)
        rows = [np.flatnonzero(column) for column in usable.T]
        changes = [
            _change(bags.values[row, k], variances[row, k], bags.times[row], float(prior[k]))
            for k, row in enumerate(rows)
        ]
        series.append((rows, changes))
    chosen = choose(
        [np.array([[np.nan if c is None else c.p_value for c in changes]]) for _, changes in series]
    )
    return [
        OverTime(rows, changes, robot.entries[0], float(robot.p_values[0]))
        for (rows, changes), robot in zip(series, chosen, strict=True)
    ]


def _change(
    values: FloatArray, variances: FloatArray, times: FloatArray, prior: float
) -> Change | None:
    """Search for a change; a robot that scatters more than others is judged by itself alone.

    A robot of which the model misses something differs from motion to motion, and what others
    scatter by would make changes of that.
    """
    change = change_of(values, variances, times, prior) if len(values) >= LEAST else None
    if change is None or prior == 0.0:
        return change
    dof = len(values) - 2
    left = float(np.sum((values - change.fitted) ** 2 / variances))
    if scipy.stats.f.sf(left / dof, dof, prior) < _SCATTERS_MORE:
        return change_of(values, variances, times)
    return change


_FEWEST_BAGS = 8  # with a time, of a robot that says something
_FEWEST_ROBOTS = 8  # of seven, not even all being positive is beyond chance at the level
_RESEMBLANCE_LEVEL = 0.01  # of the signed-rank test over robots


def resemblance(robots: Sequence[RobotBags]) -> float | None:
    """Correlation of a bag with the next of its robot: median over robots; None where none is seen.

    Each robot has one number, the mean over its quantities of the lag-one correlation of their
    deviations from the robot's mean, 1 / k added for the mean of k bags being taken from them
    (Kendall, Biometrika 41, 1954). The test over robots is that of Wilcoxon, which one robot that
    changed moves no more than any other.
    """
    correlations = [correlation for robot in robots if (correlation := _lag_one(robot)) is not None]
    if len(correlations) < _FEWEST_ROBOTS:
        return None
    test = scipy.stats.wilcoxon(correlations, alternative="greater")
    return float(np.median(correlations)) if test.pvalue < _RESEMBLANCE_LEVEL else None


def _lag_one(robot: RobotBags) -> float | None:
    """Lag-one correlation of the bags of one robot; None where there are too few."""
    values = robot.values[np.isfinite(robot.times)]
    values = values[:, np.isfinite(values).all(axis=0)]
    if len(values) < _FEWEST_BAGS or not values.shape[1]:
        return None
    rest = values - values.mean(axis=0)
    energy = np.sum(rest**2, axis=0)
    seen = energy > 0.0
    if not seen.any():
        return None
    lagged = np.sum(rest[1:] * rest[:-1], axis=0)
    return float(np.mean(lagged[seen] / energy[seen])) + 1.0 / len(values)
