"""What is compared of every bag: base parameters from its R factor, and the joints' residuals.

A residual is compared by its logarithm: it is positive, and robots differ by factors.
"""

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime, timezone
from typing import Literal

import numpy as np

from idim_iv_ros.fleet.bag_result import BagResult
from idim_iv_ros.fleet.statistics.stacking import Regression, regression
from idim_iv_ros.types import FloatArray

QuantityKind = Literal["parameter", "residual"]
_DAY = 86400.0
Model = tuple[tuple[str, ...], str, str]


@dataclass(frozen=True)
class Quantity:
    """One column: a base parameter, or the residual of a joint (N m)."""

    name: str
    kind: QuantityKind
    unit: str
    expression: str = ""
    given: float = math.nan


@dataclass(frozen=True)
class RobotBags:
    """Usable bags of one robot in the order of time.

    Attributes
    ----------
    robot : str
    bags : tuple of BagResult
        Those without a time come last.
    times : (k,) days since 1970
        NaN where unknown.
    fits : tuple of Regression
    values, variances : (k, m)
        NaN for the parameters of a bag that does not show all of them.
    """

    robot: str
    bags: tuple[BagResult, ...]
    times: FloatArray
    fits: tuple[Regression, ...]
    values: FloatArray
    variances: FloatArray


@dataclass(frozen=True)
class TypeBags:
    """Usable bags of the robots of one type.

    Attributes
    ----------
    type : str
    quantities : tuple of Quantity
    parameters : int
        The first so many are base parameters.
    robots : tuple of RobotBags
    other_model : tuple of BagResult
        With other base parameters, geometry or unit than most of the type: not comparable.
    """

    type: str
    quantities: tuple[Quantity, ...]
    parameters: int
    robots: tuple[RobotBags, ...]
    other_model: tuple[BagResult, ...]


def days_of(time: str | None) -> float:
    """Days since 1970 of an ISO 8601 stamp, UTC where it names no zone; NaN for none."""
    if time is None:
        return math.nan
    try:
        stamp = datetime.fromisoformat(time.replace("Z", "+00:00"))
    except ValueError:
        return math.nan
    if stamp.tzinfo is None:
        stamp = stamp.replace(tzinfo=timezone.utc)
    return stamp.timestamp() / _DAY


def stamp_of(days: float) -> str | None:
    """ISO 8601, UTC; None for NaN."""
    if not math.isfinite(days):
        return None
    stamp = datetime.fromtimestamp(round(days * _DAY), tz=timezone.utc)
    return stamp.strftime("%Y-%m-%dT%H:%M:%SZ")


def types_of(bags: Sequence[BagResult]) -> list[TypeBags]:
    """Group usable bags by type and robot; types and robots in the order of their names."""
    return [
        _type([bag for bag in bags if bag.type == name], name)
        for name in sorted({bag.type for bag in bags})
    ]


def _model(bag: BagResult) -> Model:
    return bag.names, bag.kinematics, bag.effort_unit


def _type(bags: Sequence[BagResult], name: str) -> TypeBags:
    models = Counter(_model(bag) for bag in bags)
    most = max(models.values())
    usual = next(model for model, count in models.items() if count == most)
    own = [bag for bag in bags if _model(bag) == usual]
    first = own[0]
    joints = [each.joint for each in first.noise]
    given = first.given or (math.nan,) * len(first.names)
    parameters = tuple(
        Quantity(name, "parameter", unit, expression, value)
        for name, unit, expression, value in zip(
            first.names, first.units, first.expressions, given, strict=True
        )
    )
    residuals = tuple(
        Quantity(f"residual {joint}", "residual", first.effort_unit) for joint in joints
    )
    robots = tuple(
        _robot([bag for bag in own if bag.robot == robot], robot, joints)
        for robot in sorted({bag.robot for bag in own})
    )
    return TypeBags(
        name,
        parameters + residuals,
        len(parameters),
        robots,
        tuple(bag for bag in bags if _model(bag) != usual),
    )


def _robot(bags: Sequence[BagResult], robot: str, joints: Sequence[str]) -> RobotBags:
    known = [(days_of(bag.time), bag) for bag in bags]
    ordered = sorted(known, key=lambda each: (math.isnan(each[0]), each[0], each[1].uri))
    fits = [regression(bag.r_factor, bag.rows) for _, bag in ordered]
    values, variances = [], []
    for (_, bag), fit in zip(ordered, fits, strict=True):
        rms = {each.joint: each.rms for each in bag.noise}
        # Variance of the logarithm of a deviation from n values: 1 / 2n.
        spread = len(joints) / (2.0 * max(bag.rows, 1))
        width = len(fit.values)
        values.append(
            [
                *(fit.values if fit.complete else np.full(width, np.nan)),
                *(_log(rms.get(joint, math.nan)) for joint in joints),
            ]
        )
        variances.append(
            [
                *(np.diag(fit.covariance) if fit.complete else np.full(width, np.nan)),
                *(spread for _ in joints),
            ]
        )
    return RobotBags(
        robot,
        tuple(bag for _, bag in ordered),
        np.array([days for days, _ in ordered]),
        tuple(fits),
        np.array(values, dtype=float),
        np.array(variances, dtype=float),
    )


def _log(value: float) -> float:
    return math.log(value) if value > 0.0 and math.isfinite(value) else math.nan
