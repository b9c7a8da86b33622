"""Numbers of a servo with their intervals, from a drive that is divided by its stiffness."""

import numpy as np
import scipy

from idim_iv_ros.servo.fit import PARAMETERS, DriveEstimate
from idim_iv_ros.servo.result import ServoNumber
from idim_iv_ros.types import FloatArray

_LEVEL = 0.95
# Largest ratio of a standard deviation to 1 / K at which it may be divided by.
_SHOWN = 1.0 / 3.0
# Name and unit of what a parameter is times the stiffness, and of the parameter itself.
_ABSOLUTE = {
    "inertia": ("armature", "kg m²"),
    "damping": ("damping", "N m s/rad"),
    "friction": ("dry friction", "N m"),
    "offset": ("offset", "N m"),
    "limit": ("torque limit", "N m"),
}
_RATIOS = {
    "inertia": ("armature / stiffness", "s²"),
    "damping": ("damping / stiffness", "s"),
    "friction": ("dry friction / stiffness", "rad"),
    "offset": ("offset / stiffness", "rad"),
    "delay": ("delay", "s"),
    "limit": ("error at the torque limit", "rad"),
}
WITH_LINKS = "inertia of drive and links / stiffness"


def interval_width(answer: DriveEstimate) -> float:
    """Half of a 95 % interval, in standard deviations that blocks of time gave (Student's t)."""
    return float(scipy.stats.t.ppf(0.5 + 0.5 * _LEVEL, max(answer.blocks - 1, 1)))


def is_absolute(answer: DriveEstimate) -> bool:
    """Whether the recording shows the stiffness in N m/rad."""
    std = float(np.sqrt(answer.covariance[0, 0]))
    return answer.drive.compliance > 0.0 and std <= _SHOWN * answer.drive.compliance


def absolute_numbers(answer: DriveEstimate, model_error: float) -> tuple[ServoNumber, ...]:
    """Stiffness, armature, damping, dry friction, offset, torque limit and friction by load.

    - `model_error`: standard deviation of the nominal torques, as a share of them
    """
    width, compliance = interval_width(answer), answer.drive.compliance
    covariance = answer.covariance.copy()
    covariance[0, 0] += (model_error * compliance) ** 2
    half = width * float(np.sqrt(covariance[0, 0]))
    lowest = compliance - half
    stiffness = ServoNumber(
        name="stiffness",
        unit="N m/rad",
        value=1.0 / compliance,
        low=1.0 / (compliance + half),
        high=1.0 / lowest if lowest > 0.0 else np.inf,
        shown=True,
    )
    numbers = [stiffness]
    for kind, (name, unit) in _ABSOLUTE.items():
        value = getattr(answer.drive, kind)
        slopes = {"compliance": -value / compliance**2, kind: 1.0 / compliance}
        numbers.append(_number(name, unit, value / compliance, slopes, covariance, width))
    by_load = answer.drive.load_friction
    slopes = {"load_friction": 1.0}
    return (*numbers, _number("friction by load", "1", by_load, slopes, covariance, width))


def ratio_numbers(answer: DriveEstimate, *, with_links: bool) -> tuple[ServoNumber, ...]:
    """Numbers of a servo that need no torque: ratios to its stiffness.

    - `with_links`: whether the inertia is that of the links, too, because they were not told apart
    """
    width, covariance, numbers = interval_width(answer), answer.covariance, []
    for kind, (name, unit) in _RATIOS.items():
        name = WITH_LINKS if kind == "inertia" and with_links else name
        value = getattr(answer.drive, kind)
        numbers.append(_number(name, unit, value, {kind: 1.0}, covariance, width))
    limit, damping = answer.drive.limit, answer.drive.damping
    if np.isfinite(limit) and damping > 0.0:
        slopes = {"limit": 1.0 / damping, "damping": -limit / damping**2}
        speed = limit / damping
        numbers.append(_number("speed at no load", "rad/s", speed, slopes, covariance, width))
    return tuple(numbers)


def _number(
    name: str,
    unit: str,
    value: float,
    slopes: dict[str, float],
    covariance: FloatArray,
    width: float,
) -> ServoNumber:
    """A number with its interval, from its derivatives by the parameters."""
    if not np.isfinite(value):
        return ServoNumber(name=name, unit=unit, value=np.nan, low=np.nan, high=np.inf, shown=False)
    slope = np.array([slopes.get(parameter, 0.0) for parameter in PARAMETERS])
    half = width * float(np.sqrt(slope @ covariance @ slope))
    low, high, either_sign = value - half, value + half, "offset" in slopes
    return ServoNumber(
        name=name,
        unit=unit,
        value=float(value),
        low=float(low if either_sign else max(low, 0.0)),
        high=float(high),
        shown=low > 0.0 or (either_sign and high < 0.0),
    )
