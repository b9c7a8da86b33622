"""From the results of all bags to one answer."""

import math
from collections import defaultdict
from collections.abc import Sequence
from importlib.metadata import version

from idim_iv_ros.errors import UsageError
from idim_iv_ros.fleet.bag_result import BagResult
from idim_iv_ros.fleet.result import Attention, FleetBag, FleetResult, FleetRobot
from idim_iv_ros.fleet.robot_answer import fleet_robot, robot_without_bags
from idim_iv_ros.fleet.statistics import screen
from idim_iv_ros.fleet.statistics.judged import judge
from idim_iv_ros.fleet.statistics.multiplicity import FALSE_DISCOVERIES
from idim_iv_ros.fleet.statistics.quantities import types_of
from idim_iv_ros.fleet.statistics.random_effects import LEVEL
from idim_iv_ros.fleet.type_answer import fleet_type

_ORDER: tuple[Attention, ...] = ("differs", "changed", "unsteady", "recordings", "none")
_SOFTWARE = ("idim-iv-ros", "numpy", "scipy")


def fleet_result(results: Sequence[BagResult]) -> FleetResult:
    """Say what the bags of a fleet say together.

    Parameters
    ----------
    results
        Of all bags, those that cannot be used among them. The order does not matter but for the
        list of bags.

    Raises
    ------
    UsageError
        There is none.
    """
    if not results:
        raise UsageError("a fleet needs at least one bag; none was found")
    why_not = _left_out(results)
    groups = types_of([bag for k, bag in enumerate(results) if k not in why_not])
    for group in groups:
        other = {id(bag) for bag in group.other_model}
        why_not.update(
            (k, f"its base parameters, geometry or unit are not those of most bags of {group.type}")
            for k, bag in enumerate(results)
            if id(bag) in other
        )
    judged = judge(groups)
    types = [fleet_type(each) for each in judged]
    unused: dict[tuple[str, str], list[BagResult]] = defaultdict(list)
    for place in why_not:
        unused[results[place].type, results[place].robot].append(results[place])
    robots = [
        fleet_robot(each, place, kind.quantities, unused.get((kind.type, robot.robot), []))
        for each, kind in zip(judged, types, strict=True)
        for place, robot in enumerate(each.bags.robots)
    ]
    seen = {(robot.type, robot.robot) for robot in robots}
    robots += [
        robot_without_bags(kind, name, bags)
        for (kind, name), bags in unused.items()
        if (kind, name) not in seen
    ]
    return FleetResult(
        false_discoveries=FALSE_DISCOVERIES,
        level=LEVEL,
        types=tuple(types),
        robots=tuple(sorted(robots, key=_urgency)),
        bags=tuple(
            FleetBag(
                uri=bag.uri,
                robot=bag.robot,
                type=bag.type,
                time=bag.time,
                status=bag.status,
                used=place not in why_not,
                why_not=why_not.get(place, ""),
                duration=bag.duration,
            )
            for place, bag in enumerate(results)
        ),
        screen=tuple(each for one in judged for each in screen.screened(one)),
        limits=screen.LIMITS,
        software={name: version(name) for name in _SOFTWARE},
    )


def _left_out(results: Sequence[BagResult]) -> dict[int, str]:
    """Bags that count for nothing, by their place, and why: unusable, or recorded twice."""
    why: dict[int, str] = {}
    first: dict[str, BagResult] = {}
    for place, bag in enumerate(results):
        if bag.status != "ok":
            why[place] = bag.reason or bag.status
        elif not bag.names:
            why[place] = "it says nothing of any base parameter"
        elif bag.content and bag.content in first:
            why[place] = f"the same recording as {first[bag.content].uri}"
        else:
            first[bag.content] = bag
    return why


def _urgency(robot: FleetRobot) -> tuple[int, float, float, str, str]:
    p_values = [p for p in (robot.p_value, robot.change_p_value) if math.isfinite(p)]
    distance = max((abs(q.distance) for q in robot.quantities if q.differs), default=0.0)
    return (
        _ORDER.index(robot.attention),
        -distance,
        min(p_values, default=1.0),
        robot.type,
        robot.robot,
    )
