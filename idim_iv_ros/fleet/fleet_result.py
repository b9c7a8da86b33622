"""From the results of all bags to the document of the fleet, fleet.json."""

import math
from collections import defaultdict
from collections.abc import Sequence
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
)
from idim_iv_ros.fleet.statistics.common_causes import causes_of_robot, common_causes, sentences
from idim_iv_ros.fleet.statistics.outliers import FALSE_DISCOVERIES
from idim_iv_ros.fleet.statistics.outliers import LEAST as LEAST_ROBOTS
from idim_iv_ros.fleet.statistics.quantities import stamp_of, types_of
from idim_iv_ros.fleet.statistics.random_effects import LEVEL, type_estimate
from idim_iv_ros.fleet.statistics.robots import ComparedType, compare_robots, resemblance
from idim_iv_ros.model.parameters import words_of_name
from idim_iv_ros.statistics.change_points import LEAST as LEAST_BAGS

_TYPICAL = 3  # ordinary robots that represent their type
_NEWEST = 3  # bags of a robot that are diagnosed
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
    Their order matters for the list of bags alone.

    Raises UsageError: there is no bag.
    """
    if not results:
        raise UsageError("a fleet needs at least one bag; none was found")
    why_not = {}
    for place, bag in enumerate(results):
        if bag.status != "ok":
            why_not[place] = bag.reason or bag.status
        elif not bag.names:
            why_not[place] = "it says nothing of any parameter"
    groups = types_of([bag for place, bag in enumerate(results) if place not in why_not])
    other = {id(bag) for group in groups for bag in group.other_model}
    unused: dict[tuple[str, str], list[BagResult]] = defaultdict(list)
    for place, bag in enumerate(results):
        if id(bag) in other:
            why_not[place] = (
                f"its base parameters, geometry or unit are not those of most bags of {bag.type}"
            )
        if place in why_not:
            unused[bag.type, bag.robot].append(bag)
    types: list[FleetType] = []
    robots: list[FleetRobot] = []
    screen: list[Screened] = []
    for compared in compare_robots(groups):
        kind = _fleet_type(compared)
        members = [
            fleet_robot(compared, place, kind.quantities, unused.pop((kind.type, robot.robot), []))
            for place, robot in enumerate(compared.bags.robots)
        ]
        types.append(kind)
        robots += members
        screen += _screen(compared, members)
    robots += [robot_without_bags(kind, name, bags) for (kind, name), bags in unused.items()]
    return FleetResult(
        false_discoveries=FALSE_DISCOVERIES,
        level=LEVEL,
        types=tuple(types),
        robots=tuple(sorted(robots, key=_urgency)),
        bags=tuple(
            FleetBag(
                **{name: getattr(bag, name) for name in _OF_BAG},
                used=place not in why_not,
                why_not=why_not.get(place, ""),
            )
            for place, bag in enumerate(results)
        ),
        screen=tuple(screen),
        software={name: version(name) for name in _SOFTWARE},
    )


def _fleet_type(compared: ComparedType) -> FleetType:
    """Return the results on one type: quantities, common causes, and what is not judged."""
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
    """Return sentences on what cannot be judged of a type, and why."""
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


def _type_quantities(compared: ComparedType) -> tuple[TypeQuantity, ...]:
    """Return each quantity over the robots that do not differ in it."""
    differing = compared.outlying.chosen.entries
    values = np.where(differing, np.nan, compared.estimates.ordinary_values)
    numbers = type_estimate(values, compared.estimates.ordinary_variances)
    numbers["between_bags"] = np.sqrt(compared.between)
    residual = [quantity.kind == "residual" for quantity in compared.bags.quantities]
    for name in ("mean", "mean_low", "mean_high", "next_low", "next_high"):
        numbers[name] = np.where(residual, np.exp(numbers[name]), numbers[name])
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
    """Return the robots of a type that deserve a diagnosis, and typical ones.

    Typical are the ordinary robots with the smallest largest studentised distance.
    """
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


# Share of a robot's bags that cannot be used from which on its recordings need attention.
_MANY_UNUSED = 0.2
_RESIDUAL = "residual "  # what names of a joint's residual begin with


def fleet_robot(
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
    """Return the result of a robot of which no bag could be used."""
    reasons = (_unused_words(bags, 0), "nothing is known of it")
    return FleetRobot(
        robot=name, type=kind, attention="recordings", reasons=reasons, bags=0, not_used=len(bags)
    )


def _quantities(compared: ComparedType, place: int) -> tuple[RobotQuantity, ...]:
    """Return all quantities of a robot in their units; residuals are compared as logarithms."""
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
    """Return a sentence on how many bags of a robot are unusable, missing or corrupt."""
    statuses = [bag.status for bag in unused]
    counts = {status: statuses.count(status) for status in ("missing", "corrupt")}
    detail = "".join(f", {count} of them {name}" for name, count in counts.items() if count)
    detail = next((f": {name}" for name, n in counts.items() if n == len(unused)), detail)
    return f"{len(unused)} of {len(unused) + used} bags could not be used{detail}"


def _difference_words(quantity: RobotQuantity, usual: TypeQuantity, joints: Sequence[str]) -> str:
    """Return a sentence on the quantity in which a robot differs from its type, and how far."""
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
    """Return a sentence on what changed, when, and by how much."""
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
    """Return a base parameter in words, with its name: “link mass at joint_2 (M2)”."""
    words = words_of_name(name, joints)
    return words if words == name else f"{words} ({name})"


def _number(value: float, digits: int = 4) -> str:
    return f"{value:.{digits}g}" if math.isfinite(value) else "unknown"
