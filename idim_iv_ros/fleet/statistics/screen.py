"""Which robots deserve a diagnosis, and what the diagnoses say together."""

from collections import defaultdict
from collections.abc import Mapping, Sequence

import numpy as np

from idim_iv_ros.fleet.bag_result import BagResult, CauseSummary
from idim_iv_ros.fleet.result import CommonCause, Screened, WhyDiagnose
from idim_iv_ros.fleet.statistics.judged import Judged
from idim_iv_ros.types import FloatArray

TYPICAL = 3  # ordinary robots that represent their type
BAGS = 3  # of a robot, the newest ones
# Share of the diagnosed ordinary robots in which a cause is one of the type, and the fewest robots.
_OF_TYPE, _OF_TYPE_LEAST = 2.0 / 3.0, 2
# Share of a robot's diagnosed bags in which a cause is one of the robot.
_OF_ROBOT = 0.5

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


def causes_of_robot(bags: Sequence[BagResult]) -> list[CauseSummary]:
    """Causes that most of its diagnosed bags name, as its newest such bag has them."""
    diagnosed = [bag.diagnosis for bag in bags if bag.diagnosis is not None]
    found: dict[tuple[str, str | None], list[CauseSummary]] = defaultdict(list)
    for diagnosis in diagnosed:
        for key, cause in {(c.effect, c.joint): c for c in diagnosis.causes}.items():
            found[key].append(cause)
    return [each[-1] for each in found.values() if len(each) > _OF_ROBOT * len(diagnosed)]


def common_causes(
    causes: Mapping[str, Sequence[CauseSummary]], ordinary: Sequence[str]
) -> tuple[CommonCause, ...]:
    """Sort the causes of diagnosed robots into those of the type and those of single robots.

    Parameters
    ----------
    causes
        By robot, of all that were diagnosed.
    ordinary
        Those of them that do not differ from their type.
    """
    robots: dict[tuple[str, str | None], list[str]] = defaultdict(list)
    kinds: dict[tuple[str, str | None], str] = {}
    for robot, found in causes.items():
        for cause in found:
            robots[cause.effect, cause.joint].append(robot)
            kinds[cause.effect, cause.joint] = cause.kind
    result = []
    for (effect, joint), names in robots.items():
        among = len(set(names) & set(ordinary))
        of_type = among >= _OF_TYPE_LEAST and among >= _OF_TYPE * len(set(ordinary))
        result.append(CommonCause(effect, kinds[effect, joint], joint, tuple(names), of_type))
    return tuple(
        sorted(result, key=lambda c: (not c.of_type, -len(c.robots), c.effect, c.joint or ""))
    )


def sentences(
    type_name: str,
    causes: Sequence[CommonCause],
    diagnosed: Sequence[str],
    ordinary: Sequence[str],
) -> tuple[str, ...]:
    """Say what the diagnoses say together; empty where none was made."""
    if not diagnosed:
        return ()
    said = []
    shared = [cause for cause in causes if cause.of_type]
    for cause in shared:
        among = len(set(cause.robots) & set(ordinary))
        said.append(
            f"{type_name}: the nominal model misses {_words(cause)} on {among} of "
            f"{len(set(ordinary))} ordinary robots that were diagnosed: a matter of the type"
        )
    if not shared and len(set(ordinary)) >= _OF_TYPE_LEAST:
        said.append(
            f"{type_name}: no cause is common to the {len(set(ordinary))} ordinary robots that "
            "were diagnosed"
        )
    for cause in causes:
        if cause.of_type:
            continue
        who = cause.robots[0] if len(cause.robots) == 1 else ", ".join(cause.robots)
        alone = " alone" if len(cause.robots) == 1 and len(diagnosed) > 1 else ""
        verb = "has" if len(cause.robots) == 1 else "have"
        said.append(f"{who}{alone} {verb} {_words(cause)}")
    return tuple(said)


def _words(cause: CommonCause) -> str:
    name = cause.effect.replace("_", " ")
    for first in ("load", "position"):
        name = name.replace(f"{first} dependent", f"{first}-dependent")
    return f"{name} at {cause.joint}" if cause.joint else name


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
