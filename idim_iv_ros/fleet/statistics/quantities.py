"""Quantities to compare, of every bag, and regressions over all bags of a robot by R factors.

Base parameters and the joints' residuals are compared, residuals as logarithms, since they are
positive and robots differ by factors.

Stacked R factors have the R factor of all rows: RᵀR = Σ R_rᵀ R_r.
"""

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime, timezone
from typing import Literal

import numpy as np

from idim_iv_ros.estimation.qr import NOT_SHOWN, independent_basis
from idim_iv_ros.fleet.regression import stacked
from idim_iv_ros.fleet.result import BagResult
from idim_iv_ros.fleet.source import iso_time, time_of
from idim_iv_ros.types import FloatArray


@dataclass(frozen=True)
class Regression:
    """Least squares from an R factor.

    `complete`: whether all parameters are identifiable; else the values are those without dependent
    columns, and the covariance is meaningless.
    """

    values: FloatArray  # (p,)
    covariance: FloatArray  # (p, p)
    squares: float  # sum of squares that is left
    dof: int  # rows less parameters
    complete: bool


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


QuantityKind = Literal["parameter", "residual"]
_DAY = 86400.0


@dataclass(frozen=True)
class Quantity:
    """One compared quantity: a base parameter, or the residual of a joint (N m)."""

    name: str
    kind: QuantityKind
    unit: str
    expression: str = ""
    given: float = math.nan


@dataclass(frozen=True)
class RobotBags:
    """Usable bags of one robot: k bags in the order of time, m quantities.

    Bags without a time come last. Values and variances are NaN for the parameters of a bag that
    does not identify all of them.
    """

    robot: str
    bags: tuple[BagResult, ...]
    times: FloatArray  # (k,), days since 1970; NaN where unknown
    fits: tuple[Regression, ...]
    values: FloatArray  # (k, m)
    variances: FloatArray  # (k, m)


@dataclass(frozen=True)
class TypeBags:
    """Usable bags of the robots of one type.

    Bags in `other_model` have other base parameters, geometry or units than most: not comparable.
    """

    type: str
    quantities: tuple[Quantity, ...]
    parameters: int  # the first so many quantities are base parameters
    robots: tuple[RobotBags, ...]
    other_model: tuple[BagResult, ...]


def stamp_of(days: float) -> str:
    """Return a time in days since 1970 as ISO 8601, UTC."""
    return iso_time(datetime.fromtimestamp(round(days * _DAY), tz=timezone.utc))


def _days_of(time: str | None) -> float:
    """Return a time in ISO 8601 as days since 1970; NaN if it is none."""
    try:
        return math.nan if time is None else time_of(time).timestamp() / _DAY
    except ValueError:
        return math.nan


def types_of(bags: Sequence[BagResult]) -> list[TypeBags]:
    """Group usable bags by type and robot, in the order of their names."""
    return [
        _type([bag for bag in bags if bag.type == name], name)
        for name in sorted({bag.type for bag in bags})
    ]


def _model(bag: BagResult) -> tuple[tuple[str, ...], str, str]:
    return bag.names, bag.kinematics, bag.effort_unit


def _type(bags: Sequence[BagResult], name: str) -> TypeBags:
    """Return the robots of a type; bags of another model than most are set aside."""
    (usual, _), *_ = Counter(map(_model, bags)).most_common(1)
    comparable = [bag for bag in bags if _model(bag) == usual]
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
    other_model = tuple(bag for bag in bags if _model(bag) != usual)
    return TypeBags(name, tuple(quantities), len(first.names), tuple(robots), other_model)


def _robot(bags: Sequence[BagResult], robot: str, joints: Sequence[str]) -> RobotBags:
    """Return the bags of a robot sorted by time, with their compared quantities."""
    dated = [(_days_of(bag.time), bag) for bag in bags]
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
