"""From the results of all bags to the document of the fleet, fleet.json."""

import math
from collections import defaultdict
from collections.abc import Sequence
from datetime import datetime, timezone
from importlib.metadata import version
from typing import get_args

import numpy as np

from idim_iv_ros.errors import UsageError
from idim_iv_ros.fleet.result import (
    Attention,
    BagResult,
    FleetBag,
    FleetResult,
    FleetRobot,
    FleetType,
    ParameterChange,
    RobotQuantity,
    Screened,
    TypeQuantity,
    iso_time,
)
from idim_iv_ros.fleet.statistics.common_causes import causes_of_robot, common_causes, sentences
from idim_iv_ros.fleet.statistics.outliers import FALSE_DISCOVERIES
from idim_iv_ros.fleet.statistics.outliers import LEAST as LEAST_ROBOTS
from idim_iv_ros.fleet.statistics.random_effects import LEVEL, type_estimate
from idim_iv_ros.fleet.statistics.robots import (
    DAY,
    ComparedType,
    compare_robots,
    resemblance,
    types_of,
)
from idim_iv_ros.model.parameters import words_of_name
from idim_iv_ros.statistics.change_points import LEAST as LEAST_BAGS
from idim_iv_ros.types import FloatArray

_TYPICAL = 3  # ordinary robots that represent their type
_NEWEST = 3  # bags of a robot that are diagnosed
# Share of a robot's bags that cannot be used from which on its recordings need attention.
_MANY_UNUSED = 0.2
_RESIDUAL = "residual "  # what names of a joint's residual begin with
_OF_BAG = ("uri", "robot", "type", "time", "status", "duration")
_SOFTWARE = ("idim-iv-ros", "numpy", "scipy")
_WHY_DIAGNOSE = {
    "differs": "differs from its type in {}",
    "changed": "{} changed over time",
    "unsteady": "{}: its bags disagree",
}


def fleet_result(results: Sequence[BagResult]) -> FleetResult:
    """Compare the robots of a fleet by the results of its bags.

    `results` are those of all bags, unusable ones included, each recording once (`identify_bags`).
    Their order matters for the list of bags alone. Raises UsageError: there is no bag.
    """
    if not results:
        raise UsageError("a fleet needs at least one bag; none was found")
    why_not = [
        (bag.reason or bag.status)
        if bag.status != "ok"
        else ("" if bag.names else "it says nothing of any parameter")
        for bag in results
    ]
    groups = types_of([bag for bag, why in zip(results, why_not, strict=True) if not why])
    other = {id(bag) for group in groups for bag in group.other_model}
    unused: dict[tuple[str, str], list[BagResult]] = defaultdict(list)
    for place, bag in enumerate(results):
        if id(bag) in other:
            most = f"most bags of {bag.type}"
            why_not[place] = f"its base parameters, geometry or unit are not those of {most}"
        if why_not[place]:
            unused[bag.type, bag.robot].append(bag)
    types: list[FleetType] = []
    robots: list[FleetRobot] = []
    screen: list[Screened] = []
    for compared in compare_robots(groups):
        kind = _fleet_type(compared)
        members = [
            _fleet_robot(compared, place, kind.quantities, unused.pop((kind.type, robot.robot), []))
            for place, robot in enumerate(compared.bags.robots)
        ]
        types.append(kind)
        robots += members
        screen += _screen(compared, members)
    robots += [
        FleetRobot(
            robot=name,
            type=kind,
            attention="recordings",
            reasons=(_unused_words(bags, 0), "nothing is known of it"),
            bags=0,
            not_used=len(bags),
        )
        for (kind, name), bags in unused.items()
    ]
    return FleetResult(
        false_discoveries=FALSE_DISCOVERIES,
        level=LEVEL,
        types=tuple(types),
        robots=tuple(sorted(robots, key=_urgency)),
        bags=tuple(
            FleetBag(**{name: getattr(bag, name) for name in _OF_BAG}, used=not why, why_not=why)
            for bag, why in zip(results, why_not, strict=True)
        ),
        screen=tuple(screen),
        software={name: version(name) for name in _SOFTWARE},
    )


def _fleet_type(compared: ComparedType) -> FleetType:
    group = compared.bags
    causes = {
        robot.robot: causes_of_robot(robot.bags)
        for robot in group.robots
        if any(bag.diagnosis is not None for bag in robot.bags)
    }
    ordinary = [
        robot.robot
        for robot, differs in zip(group.robots, compared.outlying.chosen.units, strict=True)
        if robot.robot in causes and not differs
    ]
    common = common_causes(causes, ordinary)
    return FleetType(
        type=group.type,
        robots=len(group.robots),
        bags=sum(len(robot.bags) for robot in group.robots),
        quantities=_type_quantities(compared),
        diagnosed=tuple(causes),
        causes=common,
        notes=tuple(_notes(compared)),
        sentences=sentences(group.type, common, tuple(causes), ordinary),
    )


def _notes(compared: ComparedType) -> list[str]:
    notes = []
    count = len(compared.bags.robots)
    robots = f"{count} robot{'s' if count != 1 else ''}"
    if count < LEAST_ROBOTS:
        notes.append(
            f"{robots} of this type: with fewer than {LEAST_ROBOTS} nothing says what is ordinary, "
            "and no robot is called different"
        )
    if not np.isfinite(compared.between).any():
        notes.append(
            "no robot has two bags: what differs from day to day is unknown and counts as a "
            "difference between robots"
        )
    short = sum(not math.isfinite(change.p_value) for change in compared.changes)
    if short:
        notes.append(
            f"{short} of {robots} {'has' if short == 1 else 'have'} fewer than {LEAST_BAGS} "
            "bags with a time, or all at one time: whether anything changed there is not judged"
        )
    similar = resemblance(compared.bags.robots)
    if similar is not None:
        notes.append(
            "bags that follow each other resemble each other (median correlation "
            f"{similar:.2f}), as where temperature or season move all of them: what is called a "
            "change may be such a slow movement, and its p-value and date do not know of it"
        )
    return notes


def _in_units(compared: ComparedType, values: FloatArray) -> FloatArray:
    """Return quantities (…, m) in their units: residuals are compared as logarithms."""
    residual = [quantity.kind == "residual" for quantity in compared.bags.quantities]
    return np.where(residual, np.exp(values), values)


def _type_quantities(compared: ComparedType) -> tuple[TypeQuantity, ...]:
    """Return each quantity over the robots that do not differ in it."""
    differing = compared.outlying.chosen.entries
    values = np.where(differing, np.nan, compared.estimates.ordinary_values)
    numbers = type_estimate(values, compared.estimates.ordinary_variances)
    for name in ("mean", "mean_low", "mean_high", "next_low", "next_high"):
        numbers[name] = _in_units(compared, numbers[name])
    numbers["between_bags"] = np.sqrt(compared.between)
    names = np.array([robot.robot for robot in compared.bags.robots])
    return tuple(
        TypeQuantity(
            robots=int(np.isfinite(values[:, column]).sum()),
            left_out=tuple(names[differing[:, column]].tolist()),
            **vars(quantity) | {name: float(row[column]) for name, row in numbers.items()},
        )
        for column, quantity in enumerate(compared.bags.quantities)
    )


def _screen(compared: ComparedType, robots: Sequence[FleetRobot]) -> list[Screened]:
    """Return the robots to diagnose: conspicuous ones, and the most ordinary ones of the type."""
    conspicuous: list[Screened] = []
    typical: list[tuple[float, str, Screened]] = []
    for robot, bags in zip(robots, compared.bags.robots, strict=True):
        newest = tuple(bag.uri for bag in reversed(bags.bags[-_NEWEST:]))
        why = robot.attention
        if why in ("differs", "changed", "unsteady"):
            names = ", ".join(q.name for q in robot.quantities if getattr(q, why))
            reason = _WHY_DIAGNOSE[why].format(names)
            conspicuous.append(Screened(robot.robot, robot.type, why, reason, newest))
        else:
            reason = f"represents {robot.type}: nothing about it is unusual"
            distances = [abs(q.distance) for q in robot.quantities if math.isfinite(q.distance)]
            screened = Screened(robot.robot, robot.type, "typical", reason, newest)
            typical.append((max(distances, default=0.0), robot.robot, screened))
    return conspicuous + [screened for *_, screened in sorted(typical)[:_TYPICAL]]


def _urgency(robot: FleetRobot) -> tuple[int, float, float, str, str]:
    """Return the key to sort robots: attention, largest distance, smallest p-value, names."""
    p_values = [p for p in (robot.p_value, robot.change_p_value) if math.isfinite(p)]
    distance = max((abs(q.distance) for q in robot.quantities if q.differs), default=0.0)
    attention = get_args(Attention).index(robot.attention)
    return attention, -distance, min(p_values, default=1.0), robot.type, robot.robot


def _fleet_robot(
    compared: ComparedType,
    place: int,
    type_quantities: Sequence[TypeQuantity],
    unused: Sequence[BagResult],
) -> FleetRobot:
    """Return the results on the robot at `place` of its type; its `unused` bags are counted."""
    robot, over_time = compared.bags.robots[place], compared.changes[place]
    quantities = _quantities(compared, place)
    changed = map(int, np.flatnonzero(over_time.changed))
    changes = sorted((_change(compared, place, k) for k in changed), key=lambda c: c.p_value)
    pairs = zip(quantities, type_quantities, strict=True)
    differing = [pair for pair in pairs if pair[0].differs]
    differing.sort(key=lambda pair: -abs(pair[0].distance))
    unsteady = ", ".join(q.name for q in quantities if q.unsteady)
    joints = [q.name.removeprefix(_RESIDUAL) for q in type_quantities if q.kind == "residual"]
    reasons = [_difference_words(*pair, joints) for pair in differing]
    reasons += [_change_words(change, joints) for change in changes]
    if unsteady:
        words = "bags differ from each other more than those of the other robots do"
        reasons.append(f"{unsteady}: {words}")
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


def _quantities(compared: ComparedType, place: int) -> tuple[RobotQuantity, ...]:
    estimates, outlying = compared.estimates, compared.outlying
    value, half = estimates.values[place], estimates.half[place]
    ends = _in_units(compared, np.array([value, value - half, value + half]))
    rows = {
        **dict(zip(("value", "low", "high"), ends, strict=True)),
        "distance": outlying.statistics[place],
        "p_value": outlying.p_values[place],
        "differs": outlying.chosen.entries[place],
        "changed": compared.changes[place].changed,
        "unsteady": estimates.unsteady[place],
    }
    return tuple(
        RobotQuantity(name=quantity.name, **{name: row[k].item() for name, row in rows.items()})
        for k, quantity in enumerate(compared.bags.quantities)
    )


def _change(compared: ComparedType, place: int, column: int) -> ParameterChange:
    robot, quantity = compared.bags.robots[place], compared.bags.quantities[column]
    rows, change = compared.changes[place].rows[column], compared.changes[place].changes[column]
    assert change is not None
    stamps = np.round(robot.times[rows] * DAY).tolist()
    times = tuple(iso_time(datetime.fromtimestamp(stamp, tz=timezone.utc)) for stamp in stamps)
    values, fitted = robot.values[rows, column], change.fitted
    stds = np.sqrt(robot.variances[rows, column] + np.nan_to_num(compared.between[column]))
    numbers = np.array([change.before, change.before + change.size, change.size,
                        change.size_low, change.size_high])  # fmt: skip
    if quantity.kind == "residual":
        values, fitted, numbers = np.exp(values), np.exp(fitted), np.exp(numbers)
        stds = values * stds
    sizes = ("before", "after", "size", "size_low", "size_high")
    return ParameterChange(
        name=quantity.name,
        kind=change.kind,
        unit=quantity.unit,
        p_value=change.p_value,
        begin=times[change.place],
        # A ramp begins after the bag before the first that is changed, and so may a step.
        begin_low=times[max(change.place_low - 1, 0)],
        begin_high=times[change.place_high],
        **dict(zip(sizes, numbers.tolist(), strict=True)),
        times=times,
        values=tuple(values.tolist()),
        stds=tuple(stds.tolist()),
        fitted=tuple(fitted.tolist()),
    )


def _unused_words(unused: Sequence[BagResult], used: int) -> str:
    detail = ""
    for status in ("missing", "corrupt"):
        count = sum(bag.status == status for bag in unused)
        if count == len(unused):
            detail = f": {status}"
        elif count:
            detail += f", {count} of them {status}"
    return f"{len(unused)} of {len(unused) + used} bags could not be used{detail}"


def _difference_words(quantity: RobotQuantity, usual: TypeQuantity, joints: Sequence[str]) -> str:
    far = math.isfinite(quantity.distance)
    distance = f"{abs(quantity.distance):.3g} standard deviations" if far else ""
    side = "above" if quantity.distance > 0.0 else "below"
    what = _words(quantity.name, joints)
    if usual.kind == "residual":
        factor = quantity.value / usual.mean if usual.mean > 0.0 else math.nan
        return (
            f"{what} is {factor:.3g} times that of the type "
            f"({_number(quantity.value)} {usual.unit}; {distance} {side})"
        )
    when = " before it changed" if quantity.changed else ""
    return (
        f"{what}{when} is {distance} {side} the other robots: "
        f"{_number(quantity.value)} {usual.unit}, the type has {_number(usual.mean)} ± "
        f"{_number(usual.sigma, 2)} from robot to robot"
    )


def _change_words(change: ParameterChange, joints: Sequence[str]) -> str:
    first, last = change.begin_low[:10], change.begin_high[:10]
    when = f"on {first}" if first == last else f"between {first} and {last}"
    after = f"to {_number(change.after)} {change.unit}"
    if change.name.startswith(_RESIDUAL):
        interval = f"{change.size_low:.3g} to {change.size_high:.3g}"
        numbers = f"by a factor of {change.size:.3g} ({interval}), {after}"
    else:
        interval = f"{change.size_low:+.3g} to {change.size_high:+.3g}"
        numbers = f"from {_number(change.before)} {after} (change {change.size:+.3g}, {interval})"
    what = _words(change.name, joints)
    if change.kind == "step":
        return f"{what} changed {numbers} at once, {when}"
    return f"{what} has been changing {numbers} since a time {when}"


def _words(name: str, joints: Sequence[str]) -> str:
    """Return a quantity in words: “link mass at joint_2 (M2)”, “the residual of joint_2”."""
    if name.startswith(_RESIDUAL):
        return f"the residual of {name.removeprefix(_RESIDUAL)}"
    words = words_of_name(name, joints)
    return words if words == name else f"{words} ({name})"


def _number(value: float, digits: int = 4) -> str:
    return f"{value:.{digits}g}" if math.isfinite(value) else "unknown"
