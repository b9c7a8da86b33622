"""What changed at each robot over time: steps and ramps of its bags' estimates."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from idim_iv_ros.fleet.statistics.multiplicity import choose
from idim_iv_ros.fleet.statistics.quantities import RobotBags
from idim_iv_ros.statistics.change_points import LEAST, Change, change_of
from idim_iv_ros.types import FloatArray

# Probability of so large a scatter beside a change, below which it is the robot's own.
_SCATTERS_MORE = 0.05


@dataclass(frozen=True)
class OverTime:
    """Outcome for one robot.

    Attributes
    ----------
    rows : sequence of (k,) int
        For each quantity, the bags that have an estimate and a time.
    changes : sequence of Change or None
        For each quantity, the best supported one; None where nothing can be judged.
    changed : (m,) bool
        At the false discovery rate of the fleet.
    p_value : float
        Of the robot; NaN where nothing can be judged.
    """

    rows: Sequence[NDArray[np.int64]]
    changes: Sequence[Change | None]
    changed: NDArray[np.bool_]
    p_value: float


def over_time(robots: Sequence[tuple[RobotBags, FloatArray, FloatArray]]) -> list[OverTime]:
    """Search every robot and quantity for a change, at one false discovery rate.

    Parameters
    ----------
    robots : sequence of (RobotBags, (m,), (m,))
        With the variance between the bags of an unchanged robot, NaN where it is unknown, and the
        degrees of freedom by which other robots say it.
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
        [
            np.array([np.nan if change is None else change.p_value for change in changes])[None, :]
            for _, changes in series
        ]
    )
    return [
        OverTime(rows, changes, one.entries[0], float(one.p_values[0]))
        for (rows, changes), one in zip(series, chosen, strict=True)
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
