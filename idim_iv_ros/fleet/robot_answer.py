"""One robot in the document of a fleet: its quantities, what changed, and why to look at it."""

import math
import re
from collections import defaultdict
from collections.abc import Sequence

import numpy as np

from idim_iv_ros.fleet.bag_result import BagResult
from idim_iv_ros.fleet.result import (
    AgreementTest,
    Attention,
    FleetRobot,
    ParameterChange,
    RobotQuantity,
    TypeQuantity,
)
from idim_iv_ros.fleet.statistics.quantities import stamp_of
from idim_iv_ros.fleet.statistics.robots import ComparedType
from idim_iv_ros.fleet.statistics.stacking import agreement

AGREEMENT_LEVEL = 0.05
# Share of a robot's bags that cannot be used from which on its recordings need attention.
_MANY_UNUSED = 0.2
_GROUPS = {"off": "torque offsets", "Fv": "friction", "Fc": "friction", "Fvm": "friction",
           "Fcm": "friction"}  # fmt: skip
_INERTIA = "inertia and gravity"


def fleet_robot(
    compared: ComparedType, place: int, usual: Sequence[TypeQuantity], unused: Sequence[BagResult]
) -> FleetRobot:
    """Return the robot at `place` of its type.

    Parameters
    ----------
    usual
        The quantities of its type.
    unused
        Its bags that could not be used.
    """
    robot, over = compared.bags.robots[place], compared.changes[place]
    quantities = _quantities(compared, place)
    changes = [_change(compared, place, int(column)) for column in np.flatnonzero(over.changed)]
    changes.sort(key=lambda change: change.p_value)
    differing = sorted(
        ((q, u) for q, u in zip(quantities, usual, strict=True) if q.differs),
        key=lambda pair: -abs(pair[0].distance),
    )
    unsteady = [q.name for q in quantities if q.unsteady]
    reasons = [_difference_words(q, u) for q, u in differing]
    reasons += [_change_words(change) for change in changes]
    if unsteady:
        reasons.append(
            f"{', '.join(unsteady)}: bags differ from each other more than those of the other "
            "robots do"
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
    diagnosed = [bag.diagnosis for bag in robot.bags if bag.diagnosis is not None]
    return FleetRobot(
        robot=robot.robot,
        type=compared.bags.type,
        attention=next((name for name, seen in attentions.items() if seen), "none"),
        reasons=tuple(reasons),
        bags=len(robot.bags),
        not_used=len(unused),
        first=times[0] if times else None,
        last=times[-1] if times else None,
        p_value=float(compared.outlying.chosen.p_values[place]),
        change_p_value=over.p_value,
        agreement=_agreement(compared, place),
        quantities=quantities,
        changes=tuple(changes),
        diagnosis=diagnosed[-1] if diagnosed else None,
    )


def robot_without_bags(kind: str, name: str, bags: Sequence[BagResult]) -> FleetRobot:
    """Return a robot of which no bag could be used."""
    reasons = (_unused_words(bags, 0), "nothing is known of it")
    return FleetRobot(
        robot=name, type=kind, attention="recordings", reasons=reasons, bags=0, not_used=len(bags)
    )


def _quantities(compared: ComparedType, place: int) -> tuple[RobotQuantity, ...]:
    estimates, outlying = compared.estimates, compared.outlying
    value, half = estimates.values[place], estimates.half[place]
    residual = [quantity.kind == "residual" for quantity in compared.bags.quantities]
    ends = np.array([value, value - half, value + half])
    values, low, high = np.where(residual, np.exp(ends), ends)
    return tuple(
        RobotQuantity(
            name=quantity.name,
            value=float(values[column]),
            low=float(low[column]),
            high=float(high[column]),
            distance=float(outlying.statistics[place, column]),
            p_value=float(outlying.p_values[place, column]),
            differs=bool(outlying.chosen.entries[place, column]),
            changed=bool(compared.changes[place].changed[column]),
            unsteady=bool(estimates.unsteady[place, column]),
        )
        for column, quantity in enumerate(compared.bags.quantities)
    )


def _change(compared: ComparedType, place: int, column: int) -> ParameterChange:
    robot, quantity = compared.bags.robots[place], compared.bags.quantities[column]
    rows, change = compared.changes[place].rows[column], compared.changes[place].changes[column]
    assert change is not None
    times = [stamp_of(float(time)) for time in robot.times[rows]]
    values, fitted = robot.values[rows, column], change.fitted
    stds = np.sqrt(robot.variances[rows, column] + np.nan_to_num(compared.common.variance[column]))
    numbers = np.array([change.before, change.before + change.size, change.size,
                        change.size_low, change.size_high])  # fmt: skip
    if quantity.kind == "residual":
        values, fitted, numbers = np.exp(values), np.exp(fitted), np.exp(numbers)
        stds = values * stds
    before, after, size, low, high = map(float, numbers)
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
        times=tuple(times),
        values=tuple(map(float, values)),
        stds=tuple(map(float, stds)),
        fitted=tuple(map(float, fitted)),
    )


def _agreement(compared: ComparedType, place: int) -> tuple[AgreementTest, ...]:
    group, robot = compared.bags, compared.bags.robots[place]
    usable = [bag for bag, fit in zip(robot.bags, robot.fits, strict=True) if fit.complete]
    columns: dict[str, list[int]] = defaultdict(list)
    for column, quantity in enumerate(group.quantities[: group.parameters]):
        kind = re.match(r"[A-Za-z]+", quantity.name)
        columns[_GROUPS.get(kind.group() if kind else "", _INERTIA)].append(column)
    tests = agreement(
        [bag.r_factor for bag in usable],
        [bag.rows for bag in usable],
        columns,
        alpha=AGREEMENT_LEVEL,
    )
    everything, unsteady = list(range(group.parameters)), compared.estimates.unsteady[place]
    return tuple(
        AgreementTest(
            test.scope,
            math.nan if test.p_value is None else test.p_value,
            bool(unsteady[columns.get(test.scope, everything)].any()),
        )
        for test in tests
    )


def _unused_words(unused: Sequence[BagResult], used: int) -> str:
    statuses = [bag.status for bag in unused]
    counts = {status: statuses.count(status) for status in ("missing", "corrupt")}
    parts = "".join(f", {count} of them {name}" for name, count in counts.items() if count)
    only = next((name for name, count in counts.items() if count == len(unused)), "")
    detail = f": {only}" if only else parts
    return f"{len(unused)} of {len(unused) + used} bags could not be used{detail}"


def _difference_words(quantity: RobotQuantity, usual: TypeQuantity) -> str:
    """Say in what and how far a robot differs from its type."""
    far = math.isfinite(quantity.distance)
    distance = f"{abs(quantity.distance):.3g} standard deviations" if far else ""
    side = "above" if quantity.distance > 0.0 else "below"
    if usual.kind == "residual":
        factor = quantity.value / usual.mean if usual.mean > 0.0 else math.nan
        joint = usual.name.removeprefix("residual ")
        return (
            f"the residual of {joint} is {factor:.3g} times that of the type "
            f"({_number(quantity.value)} {usual.unit}; {distance} {side})"
        )
    when = " before it changed" if quantity.changed else ""
    return (
        f"{quantity.name}{when} is {distance} {side} the other robots: {_number(quantity.value)} "
        f"{usual.unit}, the type has {_number(usual.mean)} ± {_number(usual.sigma, 2)} from robot "
        "to robot"
    )


def _change_words(change: ParameterChange) -> str:
    """Say what changed, when, and by how much."""
    first, last = change.begin_low[:10], change.begin_high[:10]
    when = f"on {first}" if first == last else f"between {first} and {last}"
    what = change.name
    numbers = (
        f"from {_number(change.before)} to {_number(change.after)} {change.unit} (change "
        f"{change.size:+.3g}, {change.size_low:+.3g} to {change.size_high:+.3g})"
    )
    if what.startswith("residual "):
        what = f"the residual of {what.removeprefix('residual ')}"
        numbers = (
            f"by a factor of {change.size:.3g} ({change.size_low:.3g} to {change.size_high:.3g}), "
            f"to {_number(change.after)} {change.unit}"
        )
    if change.kind == "step":
        return f"{what} changed {numbers} at once, {when}"
    return f"{what} has been changing {numbers} since a time {when}"


def _number(value: float, digits: int = 4) -> str:
    return f"{value:.{digits}g}" if math.isfinite(value) else "unknown"
