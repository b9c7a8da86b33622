"""What is noticed of single robots, as a part of the document."""

import math
import re
from collections import defaultdict
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from idim_iv_ros.fleet.bag_result import BagResult
from idim_iv_ros.fleet.result import (
    AgreementTest,
    Attention,
    FleetRobot,
    ParameterChange,
    RobotQuantity,
    TypeQuantity,
)
from idim_iv_ros.fleet.statistics import words
from idim_iv_ros.fleet.statistics.judged import Judged
from idim_iv_ros.fleet.statistics.outliers import Outlying
from idim_iv_ros.fleet.statistics.over_time import OverTime
from idim_iv_ros.fleet.statistics.quantities import Quantity, RobotBags, TypeBags, stamp_of
from idim_iv_ros.fleet.statistics.robots import RobotEstimate
from idim_iv_ros.fleet.statistics.stacking import agreement
from idim_iv_ros.statistics.change_points import Change

AGREEMENT_LEVEL = 0.05
# Share of a robot's bags that cannot be used from which on its recordings need attention.
_MANY_UNUSED = 0.2
_GROUPS = {"off": "torque offsets", "Fv": "friction", "Fc": "friction", "Fvm": "friction",
           "Fcm": "friction"}  # fmt: skip
_INERTIA = "inertia and gravity"


def fleet_robot(
    judged: Judged, place: int, usual: Sequence[TypeQuantity], unused: Sequence[BagResult]
) -> FleetRobot:
    """Return the robot at `place` of its type: its quantities, its changes, why to look at it.

    Parameters
    ----------
    usual
        The quantities of its type.
    unused
        Its bags that could not be used.
    """
    group, robot = judged.bags, judged.bags.robots[place]
    estimate, over, found = judged.estimates[place], judged.changes[place], judged.outlying
    quantities = tuple(
        _robot_quantity(quantity, estimate, found, over, place, column)
        for column, quantity in enumerate(group.quantities)
    )
    changes = [
        _change(
            robot,
            float(np.nan_to_num(judged.common.variance[column])),
            column,
            group.quantities[column],
            series.change,
            series.rows,
        )
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
    between: float,
    column: int,
    quantity: Quantity,
    change: Change,
    rows: NDArray[np.int64],
) -> ParameterChange:
    times = robot.times[rows]
    values = robot.values[rows, column]
    stds = np.sqrt(robot.variances[rows, column] + between)
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


def _unused_words(unused: Sequence[BagResult], used: int) -> str:
    counts = [(sum(bag.status == each for bag in unused), each) for each in ("missing", "corrupt")]
    parts = [f"{count} of them {each}" for count, each in counts if 0 < count < len(unused)]
    only = [each for count, each in counts if count == len(unused)]
    detail = f": {only[0]}" if only else "".join(f", {part}" for part in parts)
    return f"{len(unused)} of {len(unused) + used} bags could not be used{detail}"


def robot_without_bags(kind: str, name: str, bags: Sequence[BagResult]) -> FleetRobot:
    """Return a robot of which no bag could be used."""
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
