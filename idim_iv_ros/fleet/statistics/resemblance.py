"""Whether bags of a robot that follow each other resemble each other.

The search for changes takes bags of an unchanged robot for independent. Where temperature or season
move the parameters slowly they are not, and slow movements pass for changes.
"""

from collections.abc import Sequence

import numpy as np
import scipy

from idim_iv_ros.fleet.statistics.quantities import RobotBags

_FEWEST_BAGS = 8  # with a time, of a robot that says something
_FEWEST_ROBOTS = 8  # of seven, not even all being positive is beyond chance at the level
_LEVEL = 0.01  # of the signed-rank test over robots


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
    return float(np.median(correlations)) if test.pvalue < _LEVEL else None


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
