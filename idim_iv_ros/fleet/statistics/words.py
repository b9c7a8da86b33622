"""What is noticed of a robot, in sentences."""

import math

from idim_iv_ros.fleet.result import ParameterChange, RobotQuantity, TypeQuantity

_DIGITS = 4


def difference(own: RobotQuantity, usual: TypeQuantity) -> str:
    """Say in what and how far a robot differs from its type."""
    distance = f"{abs(own.distance):.3g} standard deviations" if math.isfinite(own.distance) else ""
    side = "above" if own.distance > 0.0 else "below"
    if usual.kind == "residual":
        factor = own.value / usual.mean if usual.mean > 0.0 else math.nan
        joint = usual.name.removeprefix("residual ")
        return (
            f"the residual of {joint} is {factor:.3g} times that of the type "
            f"({_number(own.value)} {usual.unit}; {distance} {side})"
        )
    when = " before it changed" if own.changed else ""
    return (
        f"{own.name}{when} is {distance} {side} the other robots: {_number(own.value)} "
        f"{usual.unit}, the type has {_number(usual.mean)} ± {_number(usual.sigma, 2)} from robot "
        "to robot"
    )


def change(found: ParameterChange) -> str:
    """Say what changed, when, and by how much."""
    first, last = found.begin_low[:10], found.begin_high[:10]
    when = f"on {first}" if first == last else f"between {first} and {last}"
    name = found.name
    if name.startswith("residual "):
        what = f"the residual of {name.removeprefix('residual ')}"
        factor = f"by a factor of {found.size:.3g} ({found.size_low:.3g} to {found.size_high:.3g})"
        numbers = f"{factor}, to {_number(found.after)} {found.unit}"
    else:
        numbers = (
            f"from {_number(found.before)} to {_number(found.after)} {found.unit} (change "
            f"{_signed(found.size)}, {_signed(found.size_low)} to {_signed(found.size_high)})"
        )
        what = name
    if found.kind == "step":
        return f"{what} changed {numbers} at once, {when}"
    return f"{what} has been changing {numbers} since a time {when}"


def _number(value: float, digits: int = _DIGITS) -> str:
    return f"{value:.{digits}g}" if math.isfinite(value) else "unknown"


def _signed(value: float) -> str:
    return f"{value:+.3g}"
