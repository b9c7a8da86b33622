"""From the results of all bags to the document of the fleet."""

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
    Screened,
    TypeQuantity,
)
from idim_iv_ros.fleet.robot_answer import fleet_robot, robot_without_bags
from idim_iv_ros.fleet.statistics.common_causes import causes_of_robot, common_causes, sentences
from idim_iv_ros.fleet.statistics.outliers import FALSE_DISCOVERIES
from idim_iv_ros.fleet.statistics.outliers import LEAST as LEAST_ROBOTS
from idim_iv_ros.fleet.statistics.quantities import types_of
from idim_iv_ros.fleet.statistics.random_effects import LEVEL, type_estimate
from idim_iv_ros.fleet.statistics.robots import ComparedType, compare_robots, resemblance
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
    """Say what the bags of a fleet say together.

    `results` are those of all bags, also of those that cannot be used, each recording once
    (`identify_bags`). Their order matters for the list of bags alone.

    Raises UsageError: there is none.
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
        screen += _screened(compared, members)
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
    """Return one type: its quantities, what diagnoses say together, and what is not judged."""
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
    """Say what of a type cannot be judged, and why."""
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


def _screened(compared: ComparedType, robots: Sequence[FleetRobot]) -> list[Screened]:
    """Return the robots of a type that deserve a diagnosis, and those that represent the type.

    These are the ordinary ones nearest to the others, by their largest studentised distance.
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
    """Return by what robots are sorted: attention, largest distance, smallest p-value, names."""
    p_values = [p for p in (robot.p_value, robot.change_p_value) if math.isfinite(p)]
    distance = max((abs(q.distance) for q in robot.quantities if q.differs), default=0.0)
    attention = get_args(Attention).index(robot.attention)
    return attention, -distance, min(p_values, default=1.0), robot.type, robot.robot
