"""Statistics of the robots of a type: estimates over all bags, changes over time, outliers.

Base parameters and the joints' residuals are compared, residuals as logarithms, since they are
positive and robots differ by factors. Stacked R factors of bags have the R factor of all rows:
RᵀR = Σ R_rᵀ R_r.
"""

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Literal

import numpy as np
import scipy

from idim_iv_ros.estimation.qr import NOT_SHOWN, independent_basis
from idim_iv_ros.fleet.regression import stacked
from idim_iv_ros.fleet.result import BagResult, time_of
from idim_iv_ros.fleet.statistics.outliers import Outlying, choose, outlying
from idim_iv_ros.fleet.statistics.random_effects import (
    LEVEL,
    between_variance,
    common_between_variance,
    generalised_q,
)
from idim_iv_ros.statistics.change_points import LEAST, Change, change_of
from idim_iv_ros.types import BoolArray, FloatArray, IntArray

DAY = 86400.0  # s
# Probability of so large a scatter around a change, below which only the robot's bags say it.
_SCATTERS_MORE = 0.05
_FEWEST_BAGS = 8  # with a time, of a robot whose successive bags say something
_FEWEST_ROBOTS = 8  # of seven, not even all being positive is beyond chance at the level
_RESEMBLANCE_LEVEL = 0.01  # of the signed-rank test over robots
# Probability that any quantity of any robot of a type is called unsteady although it is not.
_UNSTEADY_LEVEL = 0.01
_FEWEST_UNSTEADY = 3  # bags
# Bags of a robot from which on its scatter says how scatters differ, and the smallest that counts.
_FEWEST_OF_SCATTER, _LEAST_SCATTER = 3, 1e-6
_PRIORS = (1.0, 2.0, 3.0, 4.0, 6.0, 8.0, 12.0, 16.0, 24.0, 32.0, 48.0)


@dataclass(frozen=True)
class Regression:
    """Least squares from an R factor."""

    values: FloatArray  # (p,), without dependent columns
    covariance: FloatArray  # (p, p), meaningless where it is not complete
    squares: float  # sum of squares that is left
    dof: int  # rows less parameters
    complete: bool  # whether all parameters are identifiable


def regression(factor: FloatArray, rows: int) -> Regression:
    """Solve least squares from the R factor (p + 1, p + 1) of `rows` whitened rows [X y]."""
    width = factor.shape[1] - 1
    basis = independent_basis(factor[:, :width], tolerance=NOT_SHOWN)
    rest = basis.remove(factor[:, -1])
    squares = float(rest @ rest)
    dof = rows - basis.rank
    variance = squares / dof if dof > 0 else np.nan
    root = basis.inverse_root(width)
    values, complete = basis.solve(factor[:, -1], width), basis.rank == width and dof > 0
    return Regression(values, variance * root @ root.T, squares, dof, complete)


def shares(factors: Sequence[FloatArray]) -> list[FloatArray]:
    """Return matrices W_r (p, p), Σ W_r = 1, that weight estimates of bags by their R factors."""
    width = factors[0].shape[1] - 1
    root = independent_basis(stacked(factors)[:, :width], tolerance=NOT_SHOWN).inverse_root(width)
    inverse = root @ root.T
    return [inverse @ factor[:, :width].T @ factor[:, :width] for factor in factors]


@dataclass(frozen=True)
class Quantity:
    """One compared quantity: a base parameter, or the residual of a joint (N m)."""

    name: str
    kind: Literal["parameter", "residual"]
    unit: str
    expression: str = ""
    given: float = math.nan


@dataclass(frozen=True)
class RobotBags:
    """Usable bags of one robot: k bags in the order of time, m quantities."""

    robot: str
    bags: tuple[BagResult, ...]  # those without a time last
    times: FloatArray  # (k,), days since 1970; NaN where unknown
    fits: tuple[Regression, ...]
    values: FloatArray  # (k, m); NaN for parameters of a bag that does not identify all of them
    variances: FloatArray  # (k, m)

    @property
    def counts(self) -> IntArray:
        """Return the number (m,) of bags with an estimate of each quantity."""
        return np.asarray(np.isfinite(self.values + self.variances).sum(axis=0))


@dataclass(frozen=True)
class TypeBags:
    """Usable bags of the robots of one type."""

    type: str
    quantities: tuple[Quantity, ...]
    parameters: int  # the first so many quantities are base parameters
    robots: tuple[RobotBags, ...]
    other_model: tuple[BagResult, ...]  # other base parameters, geometry or units than most


def types_of(bags: Sequence[BagResult]) -> list[TypeBags]:
    """Group usable bags by type and robot, in the order of their names."""
    names = sorted({bag.type for bag in bags})
    return [_type([bag for bag in bags if bag.type == name], name) for name in names]


def _type(bags: Sequence[BagResult], name: str) -> TypeBags:
    models = [(bag.names, bag.kinematics, bag.effort_unit) for bag in bags]
    (usual, _), *_ = Counter(models).most_common(1)
    comparable = [bag for bag, model in zip(bags, models, strict=True) if model == usual]
    first = comparable[0]
    given = first.given or (math.nan,) * len(first.names)
    columns = zip(first.names, first.units, first.expressions, given, strict=True)
    quantities = [Quantity(label, "parameter", unit, text, g) for label, unit, text, g in columns]
    joints = [noise.joint for noise in first.noise]
    quantities += [Quantity(f"residual {joint}", "residual", first.effort_unit) for joint in joints]
    robots = [
        _robot([bag for bag in comparable if bag.robot == robot], robot, joints)
        for robot in sorted({bag.robot for bag in comparable})
    ]
    others = tuple(bag for bag, model in zip(bags, models, strict=True) if model != usual)
    return TypeBags(name, tuple(quantities), len(first.names), tuple(robots), others)


def _robot(bags: Sequence[BagResult], robot: str, joints: Sequence[str]) -> RobotBags:
    dated = [(time_of(bag.time).timestamp() / DAY if bag.time else math.nan, bag) for bag in bags]
    dated.sort(key=lambda pair: (math.isnan(pair[0]), pair[0], pair[1].uri))
    times, bags = np.array([days for days, _ in dated]), [bag for _, bag in dated]
    fits = tuple(regression(bag.r_factor, bag.rows) for bag in bags)
    width = len(bags[0].names)
    values, variances = np.full((2, len(bags), width + len(joints)), np.nan)
    for row, (bag, fit) in enumerate(zip(bags, fits, strict=True)):
        if fit.complete:
            values[row, :width], variances[row, :width] = fit.values, np.diag(fit.covariance)
        rms = {noise.joint: noise.rms for noise in bag.noise if noise.rms > 0.0}
        values[row, width:] = np.log([rms.get(joint, np.nan) for joint in joints])
        # Variance of the logarithm of a deviation from n values: 1 / 2n.
        variances[row, width:] = len(joints) / (2.0 * max(bag.rows, 1))
    values[~np.isfinite(values)] = np.nan
    return RobotBags(robot, tuple(bags), times, fits, values, variances)


@dataclass(frozen=True)
class OverTime:
    """Changes over time of one robot, in m quantities."""

    rows: Sequence[IntArray]  # by quantity, the bags that have an estimate and a time
    changes: Sequence[Change | None]  # the best supported ones; None where none can be judged
    changed: BoolArray  # (m,), at the false discovery rate of the fleet
    p_value: float  # of the robot; NaN where nothing can be judged


@dataclass(frozen=True)
class Estimates:
    """Estimates of k robots of a type from all their bags, in m quantities."""

    # (k, m), of one regression, and mean logarithms of residuals; NaN where not identified
    values: FloatArray
    half: FloatArray  # (k, m), of the 95 % interval
    unsteady: BoolArray  # (k, m), whether bags differ more than those of other robots
    ordinary_values: FloatArray  # (k, m), to compare by: before a change over time
    ordinary_variances: FloatArray  # (k, m)


@dataclass(frozen=True)
class ComparedType:
    """All statistics of the robots of one type, in the order of `bags.robots`."""

    bags: TypeBags
    # (m,), variance between bags of a robot beyond their noise; NaN where none has two bags
    between: FloatArray
    changes: Sequence[OverTime]
    estimates: Estimates
    outlying: Outlying


def compare_robots(groups: Sequence[TypeBags]) -> list[ComparedType]:
    """Compare robots at one false discovery rate: first changes over time, then differences."""
    between = [common_between_variance([(r.values, r.variances) for r in g.robots]) for g in groups]
    searched = []
    for group, variance in zip(groups, between, strict=True):
        scatter = np.nan_to_num(variance)
        prior = _prior(group.robots, scatter)
        searched += [_search(robot, scatter, prior) for robot in group.robots]
    tested = [
        np.array([[c.p_value if c else np.nan for c in of_robot]]) for _, of_robot in searched
    ]
    changes = (
        OverTime(rows, of_robot, chosen.entries[0], float(chosen.p_values[0]))
        for (rows, of_robot), chosen in zip(searched, choose(tested), strict=True)
    )
    by_type = [[next(changes) for _ in group.robots] for group in groups]
    estimates = list(map(_estimates, groups, between, by_type))
    outliers = outlying([(e.ordinary_values, e.ordinary_variances) for e in estimates])
    return list(map(ComparedType, groups, between, by_type, estimates, outliers))


def _search(
    robot: RobotBags, between: FloatArray, prior: FloatArray
) -> tuple[list[IntArray], list[Change | None]]:
    """Search the quantities of a robot for a change: usable bags, and the change.

    A robot that scatters more than others (`prior` (m,) degrees of freedom) is tested by its own
    scatter: else motions with a missing effect would pass for changes.
    """
    variances = robot.variances + between
    usable = np.isfinite(robot.times)[:, None] & np.isfinite(robot.values + variances)
    rows = [np.flatnonzero(column) for column in usable.T]
    changes = []
    for column, row in enumerate(rows):
        series = robot.values[row, column], variances[row, column], robot.times[row]
        dof, others = len(row) - 2, float(prior[column])
        change = change_of(*series, others) if len(row) >= LEAST else None
        if change is not None and others > 0.0:
            squares = float(np.sum((series[0] - change.fitted) ** 2 / series[1]))
            if scipy.stats.f.sf(squares / dof, dof, others) < _SCATTERS_MORE:
                change = change_of(*series)
        changes.append(change)
    return rows, changes


def _prior(robots: Sequence[RobotBags], between: FloatArray) -> FloatArray:
    """Return degrees of freedom ν (m,) with which other robots determine a robot's scatter.

    The scatters of robots are taken as F-distributed with d and ν: ν is large where all scatter
    alike, and zero where scatters are unrelated. It is found from the quartiles' distance, which a
    drifting robot does not move, and limited to the number of robots less one.
    """
    counts = np.array([robot.counts for robot in robots])
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
    between, parameters = np.nan_to_num(between), group.parameters
    common_dof = sum(np.maximum(robot.counts - 1, 0) for robot in group.robots)
    rows = []
    for robot, over_time in zip(group.robots, changes, strict=True):
        changed, dof = over_time.changed, robot.counts - 1
        q, _, _ = generalised_q(robot.values, robot.variances, between)
        surprise = scipy.stats.chi2.sf(q, np.maximum(dof, 1))
        unsteady = (dof >= _FEWEST_UNSTEADY - 1) & (surprise < alpha) & ~changed
        apart = unsteady | changed
        scatter = between_variance(robot.values, robot.variances)
        scatter = np.where(apart, np.maximum(scatter, between), between)
        dof = np.where(apart, dof, np.maximum(common_dof, 1))
        _, values, variances = generalised_q(robot.values, robot.variances, scatter)
        values[:parameters], variances[:parameters] = _pooled(robot, scatter[:parameters])
        half = scipy.stats.t.isf(0.5 * (1.0 - LEVEL), dof) * np.sqrt(variances)
        ordinary_values, ordinary_variances = values.copy(), variances.copy()
        for column in np.flatnonzero(changed):
            change = over_time.changes[int(column)]
            assert change is not None
            ordinary_values[column] = change.before
            ordinary_variances[column] = change.before_std**2
        rows.append((values, half, unsteady, ordinary_values, ordinary_variances))
    return Estimates(*map(np.array, zip(*rows, strict=True)))


def _pooled(robot: RobotBags, between: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the estimate (p,) of all rows, and its variances (p,), scatter of bags included.

    β̂ = Σ W_r β̂_r, so that bags which differ with covariance T add Σ W_r T W_rᵀ to the variance by
    the noise of the rows.
    """
    factors = [bag.r_factor for bag in robot.bags]
    whole = regression(stacked(factors), sum(bag.rows for bag in robot.bags))
    if not whole.complete:
        nothing = np.full(len(whole.values), np.nan)
        return nothing, nothing
    # The noise of the rows: what one set of parameters leaves holds the bags' differences too.
    complete = [fit for fit in robot.fits if fit.dof > 0]
    noise = sum(fit.squares for fit in complete) / max(sum(fit.dof for fit in complete), 1)
    scale = noise / (whole.squares / whole.dof) if whole.squares > 0.0 else 1.0
    variances = scale * np.diag(whole.covariance)
    for share in shares(factors):
        variances = variances + share**2 @ between
    return whole.values, variances


def resemblance(robots: Sequence[RobotBags]) -> float | None:
    """Return the median over robots of the correlation of successive bags; None if insignificant.

    Each robot has one number, the mean over its quantities of the lag-one correlation of their
    deviations from the robot's mean, plus 1 / k as a correction for the mean of k bags (Kendall,
    Biometrika 41, 1954). Wilcoxon's test over robots is used, robust against one changed robot.
    """
    correlations = []
    for robot in robots:
        values = robot.values[np.isfinite(robot.times)]
        values = values[:, np.isfinite(values).all(axis=0)]
        rest = values - values.mean(axis=0) if len(values) >= _FEWEST_BAGS else values[:0]
        energy = np.sum(rest**2, axis=0)
        moving = energy > 0.0
        if moving.any():
            lagged = np.sum(rest[1:] * rest[:-1], axis=0)
            correlations.append(np.mean(lagged[moving] / energy[moving]) + 1.0 / len(values))
    if len(correlations) < _FEWEST_ROBOTS:
        return None
    test = scipy.stats.wilcoxon(correlations, alternative="greater")
    return float(np.median(correlations)) if test.pvalue < _RESEMBLANCE_LEVEL else None
