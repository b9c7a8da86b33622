"""From the results of all bags to one answer."""

import math
import re
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version

import numpy as np

from idim_iv_ros.errors import UsageError
from idim_iv_ros.fleet.bag_result import BagResult
from idim_iv_ros.fleet.result import (
    AgreementTest,
    Attention,
    FleetBag,
    FleetResult,
    FleetRobot,
    FleetType,
    ParameterChange,
    RobotQuantity,
    Screened,
    TypeQuantity,
    WhyDiagnose,
)
from idim_iv_ros.fleet.statistics import screen, words
from idim_iv_ros.fleet.statistics.multiplicity import FALSE_DISCOVERIES
from idim_iv_ros.fleet.statistics.outliers import LEAST as LEAST_ROBOTS
from idim_iv_ros.fleet.statistics.outliers import Outlying, Population, outlying
from idim_iv_ros.fleet.statistics.over_time import OverTime, over_time
from idim_iv_ros.fleet.statistics.quantities import (
    Quantity,
    RobotBags,
    TypeBags,
    stamp_of,
    types_of,
)
from idim_iv_ros.fleet.statistics.random_effects import LEVEL, type_estimate
from idim_iv_ros.fleet.statistics.robots import (
    BetweenBags,
    RobotEstimate,
    between_bags,
    robot_estimates,
)
from idim_iv_ros.fleet.statistics.stacking import agreement
from idim_iv_ros.statistics.change_points import LEAST as LEAST_BAGS
from idim_iv_ros.statistics.change_points import Change
from idim_iv_ros.types import FloatArray

AGREEMENT_LEVEL = 0.05
# Share of a robot's bags that cannot be used from which on its recordings need attention.
_MANY_UNUSED = 0.2
_ORDER: tuple[Attention, ...] = ("differs", "changed", "unsteady", "recordings", "none")
_GROUPS = {"off": "torque offsets", "Fv": "friction", "Fc": "friction", "Fvm": "friction",
           "Fcm": "friction"}  # fmt: skip
_INERTIA = "inertia and gravity"


@dataclass(frozen=True)
class _Judged:
    """All that is known of the robots of one type."""

    bags: TypeBags
    common: BetweenBags
    changes: list[OverTime]
    estimates: list[RobotEstimate]
    outlying: Outlying


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
    judged = _judged(groups)
    unused: dict[tuple[str, str], list[BagResult]] = defaultdict(list)
    for place in why_not:
        unused[results[place].type, results[place].robot].append(results[place])
    robots = [robot for each in judged for robot in _robots(each, unused)]
    seen = {(robot.type, robot.robot) for robot in robots}
    robots += [
        _without_bags(kind, name, bags)
        for (kind, name), bags in unused.items()
        if (kind, name) not in seen
    ]
    return FleetResult(
        false_discoveries=FALSE_DISCOVERIES,
        level=LEVEL,
        types=tuple(_type(each) for each in judged),
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
        screen=tuple(each for one in judged for each in _screen(one)),
        limits=screen.LIMITS,
        software=_software(),
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


def _judged(groups: Sequence[TypeBags]) -> list[_Judged]:
    common = [between_bags(group) for group in groups]
    pairs = [
        (robot, between.variance)
        for group, between in zip(groups, common, strict=True)
        for robot in group.robots
    ]
    changes = iter(over_time(pairs))
    own = [[next(changes) for _ in group.robots] for group in groups]
    estimates = [
        robot_estimates(group, between, changed)
        for group, between, changed in zip(groups, common, own, strict=True)
    ]
    found = outlying(
        [
            Population(
                np.array([each.ordinary_values for each in one]),
                np.array([each.ordinary_variances for each in one]),
            )
            for one in estimates
        ]
    )
    return [_Judged(*each) for each in zip(groups, common, own, estimates, found, strict=True)]


def _type(judged: _Judged) -> FleetType:
    group = judged.bags
    notes = []
    robots = len(group.robots)
    if robots < LEAST_ROBOTS:
        notes.append(
            f"{robots} robot{'s' if robots != 1 else ''} of this type: with fewer than "
            f"{LEAST_ROBOTS} nothing says what is ordinary, and no robot is called different"
        )
    if not np.isfinite(judged.common.variance).any():
        notes.append(
            "no robot has two bags: what differs from day to day is unknown and counts as a "
            "difference between robots"
        )
    short = sum(int(np.isfinite(robot.times).sum()) < LEAST_BAGS for robot in group.robots)
    if short:
        notes.append(
            f"{short} of {robots} robots have fewer than {LEAST_BAGS} bags with a time: whether "
            "anything changed there is not judged"
        )
    causes = {
        robot.robot: screen.causes_of_robot(robot.bags)
        for robot in group.robots
        if any(bag.diagnosis is not None for bag in robot.bags)
    }
    ordinary = [
        robot.robot
        for robot, differs in zip(group.robots, judged.outlying.robots, strict=True)
        if robot.robot in causes and not differs
    ]
    common = screen.common_causes(causes, ordinary)
    return FleetType(
        type=group.type,
        robots=robots,
        bags=sum(len(robot.bags) for robot in group.robots),
        quantities=tuple(
            _type_quantity(judged, column, quantity)
            for column, quantity in enumerate(group.quantities)
        ),
        diagnosed=tuple(causes),
        causes=common,
        notes=tuple(notes),
        sentences=screen.sentences(group.type, common, tuple(causes), ordinary),
    )


def _type_quantity(judged: _Judged, column: int, quantity: Quantity) -> TypeQuantity:
    apart = judged.outlying.entries[:, column]
    values = np.array([each.ordinary_values[column] for each in judged.estimates])
    variances = np.array([each.ordinary_variances[column] for each in judged.estimates])
    values = np.where(apart, np.nan, values)
    found = type_estimate(values, variances)
    logarithmic = quantity.kind == "residual"
    shown = np.exp if logarithmic else (lambda value: value)
    known = np.isfinite(values)
    nan = math.nan
    mean = float(values[known][0]) if known.sum() == 1 else nan
    return TypeQuantity(
        name=quantity.name,
        kind=quantity.kind,
        expression=quantity.expression,
        unit=quantity.unit,
        robots=int(known.sum()),
        left_out=tuple(
            robot.robot for robot, out in zip(judged.bags.robots, apart, strict=True) if out
        ),
        mean=float(shown(found.mean if found else mean)),
        mean_low=float(shown(found.mean_low)) if found else nan,
        mean_high=float(shown(found.mean_high)) if found else nan,
        sigma=found.sigma if found else nan,
        sigma_low=found.sigma_low if found else nan,
        sigma_high=found.sigma_high if found else nan,
        next_low=float(shown(found.next_low)) if found else nan,
        next_high=float(shown(found.next_high)) if found else nan,
        between_bags=float(np.sqrt(judged.common.variance[column])),
        given=quantity.given,
    )


def _robots(
    judged: _Judged, unused: dict[tuple[str, str], list[BagResult]]
) -> list[FleetRobot]:
    group = judged.bags
    usual = [_type_quantity(judged, k, q) for k, q in enumerate(group.quantities)]
    return [
        _robot(judged, place, usual, unused.get((group.type, robot.robot), []))
        for place, robot in enumerate(group.robots)
    ]


def _robot(
    judged: _Judged, place: int, usual: Sequence[TypeQuantity], unused: Sequence[BagResult]
) -> FleetRobot:
    group, robot = judged.bags, judged.bags.robots[place]
    estimate, over, found = judged.estimates[place], judged.changes[place], judged.outlying
    quantities = tuple(
        _robot_quantity(quantity, estimate, found, over, place, column)
        for column, quantity in enumerate(group.quantities)
    )
    changes = [
        _change(robot, estimate, column, group.quantities[column], series.change, series.rows)
        for column, series in enumerate(over.series)
        if over.changed[column] and series.change is not None
    ]
    changes.sort(key=lambda each: each.p_value)
    differing = sorted(
        ((q, u) for q, u in zip(quantities, usual, strict=True) if q.differs),
        key=lambda each: -abs(each[0].distance),
    )
    reasons = [words.difference(q, u) for q, u in differing]
    reasons += [words.change(each) for each in changes]
    unsteady = [q.name for q in quantities if q.unsteady]
    if unsteady:
        reasons.append(
            f"{', '.join(unsteady)}: bags differ from each other more than those of the other "
            "robots do"
        )
    many = len(unused) >= _MANY_UNUSED * (len(unused) + len(robot.bags))
    if unused:
        reasons.append(_unused_words(unused, len(robot.bags)))
    attention: Attention = "none"
    if differing:
        attention = "differs"
    elif changes:
        attention = "changed"
    elif unsteady:
        attention = "unsteady"
    elif unused and many:
        attention = "recordings"
    times = [bag.time for bag in robot.bags if bag.time is not None]
    diagnosed = [bag.diagnosis for bag in robot.bags if bag.diagnosis is not None]
    return FleetRobot(
        robot=robot.robot,
        type=group.type,
        attention=attention,
        reasons=tuple(reasons),
        bags=len(robot.bags),
        not_used=len(unused),
        first=times[0] if times else None,
        last=times[-1] if times else None,
        p_value=float(found.robot_p_values[place]),
        change_p_value=over.p_value,
        agreement=_agreement(group, robot, estimate),
        quantities=quantities,
        changes=tuple(changes),
        diagnosis=diagnosed[-1] if diagnosed else None,
    )


def _robot_quantity(
    quantity: Quantity,
    estimate: RobotEstimate,
    found: Outlying,
    over: OverTime,
    place: int,
    column: int,
) -> RobotQuantity:
    value, half = float(estimate.values[column]), float(estimate.half[column])
    ends = (value, value - half, value + half)
    if quantity.kind == "residual":
        ends = tuple(math.exp(end) for end in ends)  # type: ignore[assignment]
    return RobotQuantity(
        name=quantity.name,
        value=ends[0],
        low=ends[1],
        high=ends[2],
        distance=float(found.statistics[place, column]),
        p_value=float(found.p_values[place, column]),
        differs=bool(found.entries[place, column]),
        changed=bool(over.changed[column]),
        unsteady=bool(estimate.unsteady[column]),
    )


def _change(
    robot: RobotBags,
    estimate: RobotEstimate,
    column: int,
    quantity: Quantity,
    change: Change,
    rows: np.ndarray,
) -> ParameterChange:
    times = robot.times[rows]
    values = robot.values[rows, column]
    stds = np.sqrt(robot.variances[rows, column] + estimate.between[column])
    first, last = change.place_low, change.place_high
    # A ramp begins after the bag before the first that is changed, and so may a step.
    begin_low = times[max(first - 1, 0)]
    fitted, after = change.fitted, change.before + change.size
    numbers = np.array([change.before, after, change.size, change.size_low, change.size_high])
    if quantity.kind == "residual":
        stds, values, fitted, numbers = (
            np.exp(values) * stds,
            np.exp(values),
            np.exp(fitted),
            np.exp(numbers),
        )
    before, after, size, low, high = map(float, numbers)
    return ParameterChange(
        name=quantity.name,
        kind=change.kind,
        unit=quantity.unit,
        p_value=change.p_value,
        begin=stamp_of(float(times[change.place])) or "",
        begin_low=stamp_of(float(begin_low)) or "",
        begin_high=stamp_of(float(times[last])) or "",
        before=before,
        after=after,
        size=size,
        size_low=low,
        size_high=high,
        times=tuple(stamp_of(float(time)) or "" for time in times),
        values=tuple(map(float, values)),
        stds=tuple(map(float, stds)),
        fitted=tuple(map(float, fitted)),
    )


def _agreement(
    group: TypeBags, robot: RobotBags, estimate: RobotEstimate
) -> tuple[AgreementTest, ...]:
    complete = [k for k, fit in enumerate(robot.fits) if fit.complete]
    columns: dict[str, list[int]] = defaultdict(list)
    for column, quantity in enumerate(group.quantities[: group.parameters]):
        kind = re.match(r"[A-Za-z]+", quantity.name)
        columns[_GROUPS.get(kind.group() if kind else "", _INERTIA)].append(column)
    tests = agreement(
        [robot.bags[k].r_factor for k in complete],
        [robot.bags[k].rows for k in complete],
        columns,
        alpha=AGREEMENT_LEVEL,
    )
    everything = list(range(group.parameters))
    return tuple(
        AgreementTest(
            test.scope,
            math.nan if test.p_value is None else test.p_value,
            bool(estimate.unsteady[columns.get(test.scope, everything)].any()),
        )
        for test in tests
    )


def _screen(judged: _Judged) -> list[Screened]:
    group, found = judged.bags, judged.outlying
    chosen: list[Screened] = []
    quiet: dict[str, FloatArray] = {}
    for place, robot in enumerate(group.robots):
        names = [quantity.name for quantity in group.quantities]
        differs = [name for name, out in zip(names, found.entries[place], strict=True) if out]
        changed = [
            name for name, out in zip(names, judged.changes[place].changed, strict=True) if out
        ]
        unsteady = [
            name for name, out in zip(names, judged.estimates[place].unsteady, strict=True) if out
        ]
        why: WhyDiagnose
        if differs:
            why, reason = "differs", f"differs from its type in {', '.join(differs)}"
        elif found.robots[place]:
            why, reason = "differs", "differs from its type"
        elif changed:
            why, reason = "changed", f"{', '.join(changed)} changed over time"
        elif unsteady:
            why, reason = "unsteady", f"{', '.join(unsteady)}: its bags disagree"
        else:
            quiet[robot.robot] = found.statistics[place]
            continue
        chosen.append(Screened(robot.robot, group.type, why, reason, screen.newest(robot.bags)))
    bags = {robot.robot: robot.bags for robot in group.robots}
    return chosen + [
        Screened(
            name,
            group.type,
            "typical",
            f"stands for {group.type}: nothing about it is unusual",
            screen.newest(bags[name]),
        )
        for name in screen.typical_robots(quiet)
    ]


def _unused_words(unused: Sequence[BagResult], used: int) -> str:
    corrupt = sum(bag.status == "corrupt" for bag in unused)
    detail = f", {corrupt} of them corrupt" if 0 < corrupt < len(unused) else ""
    detail = ": corrupt" if corrupt == len(unused) else detail
    return f"{len(unused)} of {len(unused) + used} bags could not be used{detail}"


def _without_bags(kind: str, name: str, bags: Sequence[BagResult]) -> FleetRobot:
    return FleetRobot(
        robot=name,
        type=kind,
        attention="recordings",
        reasons=(_unused_words(bags, 0), "nothing is known of it"),
        bags=0,
        not_used=len(bags),
        first=None,
        last=None,
        p_value=math.nan,
        change_p_value=math.nan,
        agreement=(),
        quantities=(),
        changes=(),
    )


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


def _software() -> dict[str, str]:
    names = ("idim-iv-ros", "numpy", "scipy", "statsmodels")
    found = {}
    for name in names:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    return found
