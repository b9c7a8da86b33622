"""Statistics of the robots of a type: estimates over all bags, changes over time, outliers."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
import scipy
from numpy.typing import NDArray

from idim_iv_ros.fleet.regression import stacked
from idim_iv_ros.fleet.statistics.outliers import Outlying, choose, outlying
from idim_iv_ros.fleet.statistics.quantities import RobotBags, TypeBags, regression, shares
from idim_iv_ros.fleet.statistics.random_effects import (
    LEVEL,
    between_variance,
    common_between_variance,
    generalised_q,
)
from idim_iv_ros.statistics.change_points import LEAST, Change, change_of
from idim_iv_ros.types import FloatArray

# Probability of so large a scatter around a change, below which only the robot's bags say it.
_SCATTERS_MORE = 0.05


@dataclass(frozen=True)
class OverTime:
    """Changes over time of one robot, in m quantities."""

    rows: Sequence[NDArray[np.int64]]  # by quantity, the bags that have an estimate and a time
    changes: Sequence[Change | None]  # the best supported ones; None where none can be judged
    changed: NDArray[np.bool_]  # (m,), at the false discovery rate of the fleet
    p_value: float  # of the robot; NaN where nothing can be judged


def over_time(robots: Sequence[tuple[RobotBags, FloatArray, FloatArray]]) -> list[OverTime]:
    """Search every robot and quantity for a change, at one false discovery rate.

    Each robot comes with the variance (m,) between the bags of an unchanged robot, NaN where it is
    unknown, and the degrees of freedom (m,) with which the other robots determine it.
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
    """Search values (k,) at times (k,), days, for a change; None where there are too few bags.

    A robot that scatters more than others is tested by its own scatter, since with the smaller one
    of others (`prior` degrees of freedom) motions with a missing effect would pass for changes.
    """
    change = change_of(values, variances, times, prior) if len(values) >= LEAST else None
    if change is None or prior == 0.0:
        return change
    dof = len(values) - 2
    squares = float(np.sum((values - change.fitted) ** 2 / variances))
    if scipy.stats.f.sf(squares / dof, dof, prior) < _SCATTERS_MORE:
        return change_of(values, variances, times)
    return change


_FEWEST_BAGS = 8  # with a time, of a robot that says something
_FEWEST_ROBOTS = 8  # of seven, not even all being positive is beyond chance at the level
_RESEMBLANCE_LEVEL = 0.01  # of the signed-rank test over robots


def resemblance(robots: Sequence[RobotBags]) -> float | None:
    """Return the median over robots of the correlation of successive bags; None if insignificant.

    Each robot has one number, the mean over its quantities of the lag-one correlation of their
    deviations from the robot's mean, plus 1 / k as a correction for the mean of k bags (Kendall,
    Biometrika 41, 1954). Wilcoxon's test over robots is used, robust against one changed robot.
    """
    correlations = [correlation for robot in robots if (correlation := _lag_one(robot)) is not None]
    if len(correlations) < _FEWEST_ROBOTS:
        return None
    test = scipy.stats.wilcoxon(correlations, alternative="greater")
    return float(np.median(correlations)) if test.pvalue < _RESEMBLANCE_LEVEL else None


def _lag_one(robot: RobotBags) -> float | None:
    """Return the lag-one correlation of the bags of one robot; None where there are too few."""
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


# Probability that any quantity of any robot of a type is called unsteady although it is not.
_UNSTEADY_LEVEL = 0.01
_FEWEST_UNSTEADY = 3  # bags
# Bags of a robot from which on its scatter says how scatters differ, and the smallest that counts.
_FEWEST_OF_SCATTER, _LEAST_SCATTER = 3, 1e-6
_PRIORS = (1.0, 2.0, 3.0, 4.0, 6.0, 8.0, 12.0, 16.0, 24.0, 32.0, 48.0)


@dataclass(frozen=True)
class Estimates:
    """Estimates of k robots of a type from all their bags, in m quantities.

    `values` are of one regression over all bags, and mean logarithms for residuals; NaN where the
    bags do not identify a parameter. `half` is half of the 95 % interval. The bags of an `unsteady`
    robot differ more than those of other robots. Ordinary values are those to compare robots by: if
    a quantity changed over time, its value before.
    """

    values: FloatArray  # (k, m)
    half: FloatArray  # (k, m)
    unsteady: NDArray[np.bool_]  # (k, m)
    ordinary_values: FloatArray  # (k, m)
    ordinary_variances: FloatArray  # (k, m)


@dataclass(frozen=True)
class ComparedType:
    """All statistics of the robots of one type, in the order of `bags.robots`.

    `between` is the variance between the bags of one robot beyond their noise, common to the robots
    of the type; NaN where no robot has two bags.
    """

    bags: TypeBags
    between: FloatArray  # (m,)
    changes: Sequence[OverTime]
    estimates: Estimates
    outlying: Outlying


def compare_robots(groups: Sequence[TypeBags]) -> list[ComparedType]:
    """Compare the robots of all types: first changes over time, then differences.

    Robots of all types share one false discovery rate.
    """
    between = [common_between_variance([(r.values, r.variances) for r in g.robots]) for g in groups]
    series = []
    for group, variance in zip(groups, between, strict=True):
        prior = _prior(group.robots, np.nan_to_num(variance))
        series += [(robot, variance, prior) for robot in group.robots]
    changes = iter(over_time(series))
    by_type = [[next(changes) for _ in group.robots] for group in groups]
    estimates = list(map(_estimates, groups, between, by_type))
    outliers = outlying([(e.ordinary_values, e.ordinary_variances) for e in estimates])
    return list(map(ComparedType, groups, between, by_type, estimates, outliers))


def _counts(robots: Sequence[RobotBags]) -> NDArray[np.int64]:
    """Return the number (k, m) of bags of each robot with an estimate of each quantity."""
    return np.array([np.isfinite(robot.values + robot.variances).sum(axis=0) for robot in robots])


def _prior(robots: Sequence[RobotBags], between: FloatArray) -> FloatArray:
    """Return degrees of freedom ν (m,) with which other robots determine a robot's scatter.

    The scatters of robots are taken as F-distributed with d and ν: ν is large where all scatter
    alike, and zero where scatters are unrelated. It is found from the quartiles' distance, which a
    drifting robot does not move, and limited to the number of robots less one.
    """
    counts = _counts(robots)
    q = np.array([generalised_q(robot.values, robot.variances, between)[0] for robot in robots])
    prior = np.zeros(len(between))
    for column in range(len(between)):
        scattering = counts[:, column] >= _FEWEST_OF_SCATTER
        most = float(np.sum(scattering)) - 1.0
        if most < 1.0:
            continue
        dof = counts[scattering, column] - 1.0
        scatter = np.log(np.maximum(q[scattering, column] / dof, _LEAST_SCATTER))
        spread = float(np.subtract(*np.quantile(scatter, [0.75, 0.25])))
        able = [nu for nu in _PRIORS if nu <= most and _spread(float(np.median(dof)), nu) >= spread]
        # The spread falls with ν: the largest that still makes so large a one.
        prior[column] = max(able, default=0.0)
    return prior


@cache
def _spread(dof: float, prior: float) -> float:
    """Return the quartiles' distance of log F with (dof, prior) degrees of freedom."""
    return float(np.subtract(*np.log(scipy.stats.f.ppf([0.75, 0.25], dof, prior))))


def _estimates(group: TypeBags, between: FloatArray, changes: Sequence[OverTime]) -> Estimates:
    """Estimate all robots of a type; a quantity that changed is not also called unsteady."""
    tests = sum(robot.values.shape[1] for robot in group.robots if len(robot.bags) > 1)
    alpha = _UNSTEADY_LEVEL / max(tests, 1)
    dof = np.maximum(_counts(group.robots) - 1, 0).sum(axis=0)
    rows = [
        _estimate(robot, group.parameters, between, dof, change, alpha)
        for robot, change in zip(group.robots, changes, strict=True)
    ]
    return Estimates(*map(np.array, zip(*rows, strict=True)))


def _estimate(
    robot: RobotBags,
    parameters: int,
    between: FloatArray,
    common_dof: NDArray[np.int64],
    changes: OverTime,
    alpha: float,
) -> tuple[FloatArray, ...]:
    """Return the rows (m,) of `Estimates` for one robot; `between` (m,) is the bags' variance."""
    between = np.nan_to_num(between)
    (count,) = _counts([robot])
    q, _, _ = generalised_q(robot.values, robot.variances, between)
    surprise = scipy.stats.chi2.sf(q, np.maximum(count - 1, 1))
    unsteady = (count >= _FEWEST_UNSTEADY) & (surprise < alpha) & ~changes.changed
    apart = unsteady | changes.changed
    scatter = between_variance(robot.values, robot.variances)
    between = np.where(apart, np.maximum(scatter, between), between)
    dof = np.where(apart, count - 1, np.maximum(common_dof, 1))
    _, values, variances = generalised_q(robot.values, robot.variances, between)
    values[:parameters], variances[:parameters] = _pooled(robot, between[:parameters])
    half = scipy.stats.t.isf(0.5 * (1.0 - LEVEL), dof) * np.sqrt(variances)
    ordinary_values, ordinary_variances = values.copy(), variances.copy()
    for column in np.flatnonzero(changes.changed):
        change = changes.changes[int(column)]
        assert change is not None
        ordinary_values[column] = change.before
        ordinary_variances[column] = change.before_std**2
    return values, half, unsteady, ordinary_values, ordinary_variances


def _pooled(robot: RobotBags, between: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the estimate (p,) of all rows, and its variances (p,), scatter of bags included.

    β̂ = Σ W_r β̂_r, so that bags which differ with covariance T add Σ W_r T W_rᵀ to the variance by
    the noise of the rows.
    """
    factors = [bag.r_factor for bag in robot.bags]
    rows = sum(bag.rows for bag in robot.bags)
    whole = regression(stacked(factors), rows)
    width = len(whole.values)
    if not whole.complete:
        return np.full(width, np.nan), np.full(width, np.nan)
    # The noise of the rows: what one set of parameters leaves holds the bags' differences too.
    complete = [fit for fit in robot.fits if fit.dof > 0]
    noise = sum(fit.squares for fit in complete) / max(sum(fit.dof for fit in complete), 1)
    scale = noise / (whole.squares / whole.dof) if whole.squares > 0.0 else 1.0
    variances = scale * np.diag(whole.covariance)
    for share in shares(factors):
        variances = variances + share**2 @ between
    return whole.values, variances
