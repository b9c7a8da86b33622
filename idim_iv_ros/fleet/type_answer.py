"""What the robots of one type have in common, as a part of the document."""

import math

import numpy as np

from idim_iv_ros.fleet.result import FleetType, TypeQuantity
from idim_iv_ros.fleet.statistics.common_causes import causes_of_robot, common_causes, sentences
from idim_iv_ros.fleet.statistics.judged import Judged
from idim_iv_ros.fleet.statistics.outliers import LEAST as LEAST_ROBOTS
from idim_iv_ros.fleet.statistics.random_effects import type_estimate
from idim_iv_ros.fleet.statistics.resemblance import resemblance
from idim_iv_ros.statistics.change_points import LEAST as LEAST_BAGS


def fleet_type(judged: Judged) -> FleetType:
    """Return one type: its quantities, what diagnoses say together, and what is not judged."""
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
    short = sum(not math.isfinite(each.p_value) for each in judged.changes)
    if short:
        verb = "has" if short == 1 else "have"
        notes.append(
            f"{short} of {robots} robot{'s' if robots != 1 else ''} {verb} fewer than {LEAST_BAGS} "
            "bags with a time, or all at one time: whether anything changed there is not judged"
        )
    similar = resemblance(group.robots)
    if similar is not None:
        notes.append(
            "bags that follow each other resemble each other (median correlation "
            f"{similar:.2f}), as where temperature or season move all of them: what is called a "
            "change may be such a slow movement, and its p-value and date do not know of it"
        )
    causes = {
        robot.robot: causes_of_robot(robot.bags)
        for robot in group.robots
        if any(bag.diagnosis is not None for bag in robot.bags)
    }
    ordinary = [
        robot.robot
        for robot, differs in zip(group.robots, judged.outlying.robots, strict=True)
        if robot.robot in causes and not differs
    ]
    common = common_causes(causes, ordinary)
    return FleetType(
        type=group.type,
        robots=robots,
        bags=sum(len(robot.bags) for robot in group.robots),
        quantities=_type_quantities(judged),
        diagnosed=tuple(causes),
        causes=common,
        notes=tuple(notes),
        sentences=sentences(group.type, common, tuple(causes), ordinary),
    )


def _type_quantities(judged: Judged) -> tuple[TypeQuantity, ...]:
    apart = judged.outlying.entries
    values = np.array([robot.ordinary_values for robot in judged.estimates])
    variances = np.array([robot.ordinary_variances for robot in judged.estimates])
    values = np.where(apart, np.nan, values)
    numbers = type_estimate(values, variances)
    numbers["between_bags"] = np.sqrt(judged.common.variance)
    residual = [quantity.kind == "residual" for quantity in judged.bags.quantities]
    for name in ("mean", "mean_low", "mean_high", "next_low", "next_high"):
        numbers[name] = np.where(residual, np.exp(numbers[name]), numbers[name])
    return tuple(
        TypeQuantity(
            name=quantity.name,
            kind=quantity.kind,
            expression=quantity.expression,
            unit=quantity.unit,
            robots=int(np.isfinite(values[:, column]).sum()),
            left_out=tuple(
                robot.robot
                for robot, out in zip(judged.bags.robots, apart[:, column], strict=True)
                if out
            ),
            given=quantity.given,
            **{name: float(number[column]) for name, number in numbers.items()},
        )
        for column, quantity in enumerate(judged.bags.quantities)
    )
