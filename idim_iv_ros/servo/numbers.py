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
    "load_friction": ("friction by load", "1"),
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
    values, width = np.array(answer.drive), interval_width(answer)
    covariance = answer.covariance.copy()
    compliance = answer.drive.compliance
    covariance[0, 0] += (model_error * compliance) ** 2
    std = float(np.sqrt(covariance[0, 0]))
    lowest = compliance - width * std
    numbers = [
        ServoNumber(
            name="stiffness",
            unit="N m/rad",
            value=1.0 / compliance,
            low=1.0 / (compliance + width * std),
            high=1.0 / lowest if lowest > 0.0 else np.inf,
            shown=True,
        )
    ]
    for kind, (name, unit) in _ABSOLUTE.items():
        place = PARAMETERS.index(kind)
        slope = np.zeros(len(values))
        value = values[place] if kind == "load_friction" else values[place] / compliance
        if kind == "load_friction":
            slope[place] = 1.0
        elif np.isfinite(values[place]):
            slope[0], slope[place] = -values[place] / compliance**2, 1.0 / compliance
        numbers.append(_number(kind, name, unit, value, slope, covariance, width))
    return tuple(numbers)


def ratio_numbers(answer: DriveEstimate, *, with_links: bool) -> tuple[ServoNumber, ...]:
    """Numbers of a servo that need no torque: ratios to its stiffness.

    - `with_links`: whether the inertia is that of the links, too, because they were not told apart
    """
    values, width = np.array(answer.drive), interval_width(answer)
    numbers = []
    for kind, (name, unit) in _RATIOS.items():
        place = PARAMETERS.index(kind)
        slope = np.zeros(len(values))
        slope[place] = float(np.isfinite(values[place]))
        if kind == "inertia" and with_links:
            name = WITH_LINKS
        numbers.append(_number(kind, name, unit, values[place], slope, answer.covariance, width))
    limit, damping = answer.drive.limit, answer.drive.damping
    slope = np.zeros(len(values))
    if np.isfinite(limit) and damping > 0.0:
        slope[PARAMETERS.index("limit")] = 1.0 / damping
        slope[PARAMETERS.index("damping")] = -limit / damping**2
        speed = limit / damping
        numbers.append(
            _number("limit", "speed at no load", "rad/s", speed, slope, answer.covariance, width)
        )
    return tuple(numbers)


def _number(
    kind: str,
    name: str,
    unit: str,
    value: float,
    slope: FloatArray,
    covariance: FloatArray,
    width: float,
) -> ServoNumber:
    """A number with its interval, from its derivatives by the parameters."""
    half = width * float(np.sqrt(slope @ covariance @ slope))
    if not np.isfinite(value):
        return ServoNumber(name=name, unit=unit, value=np.nan, low=np.nan, high=np.inf, shown=False)
    low, high = value - half, value + half
    shown = low > 0.0 or (kind == "offset" and high < 0.0)
    return ServoNumber(
        name=name,
        unit=unit,
        value=float(value),
        low=float(low if kind == "offset" else max(low, 0.0)),
        high=float(high),
        shown=shown,
    )
