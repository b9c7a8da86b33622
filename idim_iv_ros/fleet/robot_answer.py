"""One robot in the document of a fleet: its quantities, what changed, and why to look at it."""

import math
from collections.abc import Sequence

import numpy as np

from idim_iv_ros.fleet.result import (
    Attention,
    BagResult,
    FleetRobot,
    ParameterChange,
    RobotQuantity,
    TypeQuantity,
)
from idim_iv_ros.fleet.statistics.quantities import stamp_of
from idim_iv_ros.fleet.statistics.robots import ComparedType
from idim_iv_ros.model.parameters import words_of_name

# Share of a robot's bags that cannot be used from which on its recordings need attention.
_MANY_UNUSED = 0.2
_RESIDUAL = "residual "  # what names of a joint's residual begin with


def fleet_robot(
    compared: ComparedType,
    place: int,
    type_quantities: Sequence[TypeQuantity],
    unused: Sequence[BagResult],
) -> FleetRobot:
    """Return the robot at `place` of its type, with its `unused` bags counted."""
    robot, over_time = compared.bags.robots[place], compared.changes[place]
    quantities = _quantities(compared, place)
    changed = map(int, np.flatnonzero(over_time.changed))
    changes = sorted((_change(compared, place, k) for k in changed), key=lambda c: c.p_value)
    differing = sorted(
        ((q, usual) for q, usual in zip(quantities, type_quantities, strict=True) if q.differs),
        key=lambda pair: -abs(pair[0].distance),
    )
    unsteady = ", ".join(q.name for q in quantities if q.unsteady)
    joints = [
        usual.name.removeprefix(_RESIDUAL) for usual in type_quantities if usual.kind == "residual"
    ]
    reasons = [_difference_words(*pair, joints) for pair in differing]
    reasons += [_change_words(change, joints) for change in changes]
    if unsteady:
        reasons.append(
            f"{unsteady}: bags differ from each other more than those of the other robots do"
        )
    if unused:
        reasons.append(_unused_words(unused, len(robot.bags)))
    many = len(unused) >= _MANY_UNUSED * (len(unused) + len(robot.bags))
    attentions: dict[Attention, bool] = {
        "differs": bool(differing),
        "changed": bool(changes),
        "unsteady": bool(unsteady),
        "recordings": bool(unused) and many,
    }
    times = [bag.time for bag in robot.bags if bag.time is not None]
    diagnoses = [bag.diagnosis for bag in robot.bags if bag.diagnosis is not None]
    return FleetRobot(
        robot=robot.robot,
        type=compared.bags.type,
        attention=next((name for name, applies in attentions.items() if applies), "none"),
        reasons=tuple(reasons),
        bags=len(robot.bags),
        not_used=len(unused),
        first=times[0] if times else None,
        last=times[-1] if times else None,
        p_value=float(compared.outlying.chosen.p_values[place]),
        change_p_value=over_time.p_value,
        quantities=quantities,
        changes=tuple(changes),
        diagnosis=diagnoses[-1] if diagnoses else None,
    )


def robot_without_bags(kind: str, name: str, bags: Sequence[BagResult]) -> FleetRobot:
    """Return a robot of which no bag could be used."""
    reasons = (_unused_words(bags, 0), "nothing is known of it")
    return FleetRobot(
        robot=name, type=kind, attention="recordings", reasons=reasons, bags=0, not_used=len(bags)
    )


def _quantities(compared: ComparedType, place: int) -> tuple[RobotQuantity, ...]:
    """Return all quantities of a robot; residuals, compared by logarithms, in their own unit."""
    estimates, outlying = compared.estimates, compared.outlying
    value, half = estimates.values[place], estimates.half[place]
    residual = [quantity.kind == "residual" for quantity in compared.bags.quantities]
    ends = np.array([value, value - half, value + half])
    values, low, high = np.where(residual, np.exp(ends), ends)
    return tuple(
        RobotQuantity(
            name=quantity.name,
            value=float(values[k]),
            low=float(low[k]),
            high=float(high[k]),
            distance=float(outlying.statistics[place, k]),
            p_value=float(outlying.p_values[place, k]),
            differs=bool(outlying.chosen.entries[place, k]),
            changed=bool(compared.changes[place].changed[k]),
            unsteady=bool(estimates.unsteady[place, k]),
        )
        for k, quantity in enumerate(compared.bags.quantities)
    )


def _change(compared: ComparedType, place: int, column: int) -> ParameterChange:
    """Return the change of one quantity of a robot, with the series in which it was found."""
    robot, quantity = compared.bags.robots[place], compared.bags.quantities[column]
    rows, change = compared.changes[place].rows[column], compared.changes[place].changes[column]
    assert change is not None
    times = tuple(stamp_of(float(time)) for time in robot.times[rows])
    values, fitted = robot.values[rows, column], change.fitted
    stds = np.sqrt(robot.variances[rows, column] + np.nan_to_num(compared.between[column]))
    numbers = np.array([change.before, change.before + change.size, change.size,
                        change.size_low, change.size_high])  # fmt: skip
    if quantity.kind == "residual":
        values, fitted, numbers = np.exp(values), np.exp(fitted), np.exp(numbers)
        stds = values * stds
    before, after, size, low, high = numbers.tolist()
    return ParameterChange(
        name=quantity.name,
        kind=change.kind,
        unit=quantity.unit,
        p_value=change.p_value,
        begin=times[change.place],
        # A ramp begins after the bag before the first that is changed, and so may a step.
        begin_low=times[max(change.place_low - 1, 0)],
        begin_high=times[change.place_high],
        before=before,
        after=after,
        size=size,
        size_low=low,
        size_high=high,
        times=times,
        values=tuple(values.tolist()),
        stds=tuple(stds.tolist()),
        fitted=tuple(fitted.tolist()),
    )


def _unused_words(unused: Sequence[BagResult], used: int) -> str:
    """Say how many bags of a robot could not be used, and how many are missing or corrupt."""
    statuses = [bag.status for bag in unused]
    counts = {status: statuses.count(status) for status in ("missing", "corrupt")}
    detail = "".join(f", {count} of them {name}" for name, count in counts.items() if count)
    detail = next((f": {name}" for name, n in counts.items() if n == len(unused)), detail)
    return f"{len(unused)} of {len(unused) + used} bags could not be used{detail}"


def _difference_words(quantity: RobotQuantity, usual: TypeQuantity, joints: Sequence[str]) -> str:
    """Say in what and how far a robot differs from its type."""
    far = math.isfinite(quantity.distance)
    distance = f"{abs(quantity.distance):.3g} standard deviations" if far else ""
    side = "above" if quantity.distance > 0.0 else "below"
    if usual.kind == "residual":
        factor = quantity.value / usual.mean if usual.mean > 0.0 else math.nan
        joint = usual.name.removeprefix(_RESIDUAL)
        return (
            f"the residual of {joint} is {factor:.3g} times that of the type "
            f"({_number(quantity.value)} {usual.unit}; {distance} {side})"
        )
    when = " before it changed" if quantity.changed else ""
    return (
        f"{_parameter_words(quantity.name, joints)}{when} is {distance} {side} the other robots: "
        f"{_number(quantity.value)} {usual.unit}, the type has {_number(usual.mean)} ± "
        f"{_number(usual.sigma, 2)} from robot to robot"
    )


def _change_words(change: ParameterChange, joints: Sequence[str]) -> str:
    """Say what changed, when, and by how much."""
    first, last = change.begin_low[:10], change.begin_high[:10]
    when = f"on {first}" if first == last else f"between {first} and {last}"
    what = _parameter_words(change.name, joints)
    numbers = (
        f"from {_number(change.before)} to {_number(change.after)} {change.unit} (change "
        f"{change.size:+.3g}, {change.size_low:+.3g} to {change.size_high:+.3g})"
    )
    if change.name.startswith(_RESIDUAL):
        what = f"the residual of {change.name.removeprefix(_RESIDUAL)}"
        numbers = (
            f"by a factor of {change.size:.3g} ({change.size_low:.3g} to {change.size_high:.3g}), "
            f"to {_number(change.after)} {change.unit}"
        )
    if change.kind == "step":
        return f"{what} changed {numbers} at once, {when}"
    return f"{what} has been changing {numbers} since a time {when}"


def _parameter_words(name: str, joints: Sequence[str]) -> str:
    """Say what a base parameter is, with its name in the tables: “link mass at joint_2 (M2)”."""
    words = words_of_name(name, joints)
    return words if words == name else f"{words} ({name})"


def _number(value: float, digits: int = 4) -> str:
    return f"{value:.{digits}g}" if math.isfinite(value) else "unknown"
