"""Which robots deserve a diagnosis."""

from collections.abc import Mapping, Sequence

import numpy as np

from idim_iv_ros.fleet.bag_result import BagResult
from idim_iv_ros.fleet.result import Screened, WhyDiagnose
from idim_iv_ros.fleet.statistics.judged import Judged
from idim_iv_ros.types import FloatArray

TYPICAL = 3  # ordinary robots that represent their type
BAGS = 3  # of a robot, the newest ones

LIMITS = (
    "Robots are compared in their base parameters and in the residual of each joint. An effect "
    "that all robots of a type share raises all their residuals and makes none of them stand out: "
    "that is why ordinary robots are diagnosed, too.",
    "What a residual consists of (backlash, load-dependent friction, a ripple) is not in an R "
    "factor: only a diagnosis of the bags says it.",
    "An effect that is smaller than what bags of one robot differ by, or than what robots of the "
    "type differ by, is not found here.",
    "Parameters of R factors are those of least squares: noise of the encoders moves those of all "
    "robots equally, so that differences and changes are right and means may be off by a little.",
)


def typical_robots(distances: Mapping[str, FloatArray]) -> list[str]:
    """Names of the robots nearest to the middle of their type, the nearest first.

    Parameters
    ----------
    distances
        Of robots that need no attention: (m,) studentised distances from the others, NaN where
        there is none.
    """
    nearest = sorted(
        (float(np.nanmax(np.abs(np.append(d, 0.0)))), name) for name, d in distances.items()
    )
    return [name for _, name in nearest[:TYPICAL]]


def newest(bags: Sequence[BagResult]) -> tuple[str, ...]:
    """URIs of the newest bags; `bags` in the order of time."""
    return tuple(bag.uri for bag in reversed(bags[-BAGS:]))


def screened(judged: Judged) -> list[Screened]:
    """Robots of a type that deserve a diagnosis, and those that represent the type."""
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
        elif changed:
            why, reason = "changed", f"{', '.join(changed)} changed over time"
        elif unsteady:
            why, reason = "unsteady", f"{', '.join(unsteady)}: its bags disagree"
        else:
            quiet[robot.robot] = found.statistics[place]
            continue
        chosen.append(Screened(robot.robot, group.type, why, reason, newest(robot.bags)))
    bags = {robot.robot: robot.bags for robot in group.robots}
    return chosen + [
        Screened(
            name,
            group.type,
            "typical",
            f"represents {group.type}: nothing about it is unusual",
            newest(bags[name]),
        )
        for name in typical_robots(quiet)
    ]
