"""What the robots of one type have in common, as a part of the document."""

import math

import numpy as np

from idim_iv_ros.fleet.result import FleetType, TypeQuantity
from idim_iv_ros.fleet.statistics.common_causes import causes_of_robot, common_causes, sentences
from idim_iv_ros.fleet.statistics.judged import Judged
from idim_iv_ros.fleet.statistics.outliers import LEAST as LEAST_ROBOTS
from idim_iv_ros.fleet.statistics.quantities import Quantity
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
        quantities=tuple(
            _type_quantity(judged, column, quantity)
            for column, quantity in enumerate(group.quantities)
        ),
        diagnosed=tuple(causes),
        causes=common,
        notes=tuple(notes),
        sentences=sentences(group.type, common, tuple(causes), ordinary),
    )


def _type_quantity(judged: Judged, column: int, quantity: Quantity) -> TypeQuantity:
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
