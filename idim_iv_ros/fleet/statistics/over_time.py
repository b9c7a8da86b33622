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
