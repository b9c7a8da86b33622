"""All that the statistics say of the robots of one type."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from idim_iv_ros.fleet.statistics.outliers import Outlying, Population, outlying
from idim_iv_ros.fleet.statistics.over_time import OverTime, over_time
from idim_iv_ros.fleet.statistics.quantities import TypeBags
from idim_iv_ros.fleet.statistics.robots import (
    BetweenBags,
    RobotEstimate,
    between_bags,
    robot_estimates,
)


@dataclass(frozen=True)
class Judged:
    """All that is known of the robots of one type; lists are in the order of `bags.robots`."""

    bags: TypeBags
    common: BetweenBags
    changes: list[OverTime]
    estimates: list[RobotEstimate]
    outlying: Outlying


def judge(groups: Sequence[TypeBags]) -> list[Judged]:
    """Judge the robots of all types: changes first, since what changed is compared as it was.

    Robots of all types share one false discovery rate.
    """
    common = [between_bags(group) for group in groups]
    pairs = [
        (robot, between.variance, between.prior)
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
    return [Judged(*each) for each in zip(groups, common, own, estimates, found, strict=True)]
