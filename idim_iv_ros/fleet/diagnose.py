"""Screen, then diagnose: the full diagnosis for the robots that the statistics name.

Robots of a type are compared by R factors first. Only those that differ or changed are diagnosed,
each from its newest bags together, and a few ordinary ones for what all of the type share.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from idim_iv_ros.diagnosis.diagnose import diagnose
from idim_iv_ros.diagnosis.result import GapResult
from idim_iv_ros.errors import IdimError
from idim_iv_ros.fleet.bag_result import BagResult, CauseSummary, GapSummary
from idim_iv_ros.fleet.content import code_version, key_of
from idim_iv_ros.fleet.fleet_result import fleet_result
from idim_iv_ros.fleet.identify import identify_bags
from idim_iv_ros.fleet.remote import open_bag
from idim_iv_ros.fleet.result import FleetResult, Screened
from idim_iv_ros.fleet.robots import Robot, robots_of
from idim_iv_ros.fleet.run import FleetRun
from idim_iv_ros.fleet.source import find_bags
from idim_iv_ros.fleet.statistics.common_causes import is_nothing
from idim_iv_ros.progress import Progress, part_of

DIAGNOSES = "diagnoses"  # folder of the diagnoses of robots, below the results of the fleet
# Share of the progress that the identification of the bags takes.
_IDENTIFIED = 0.5


@dataclass(frozen=True)
class RobotDiagnosis:
    """The diagnosis of one robot of a fleet, or the reason why there is none.

    `gap` has the series that a report draws where it was made in this run.
    """

    screened: Screened
    gap: GapResult | None
    reason: str = ""


@dataclass(frozen=True)
class Fleet:
    """All results of a fleet.

    `bags` are in the order of the source, `diagnoses` in that of `FleetResult.screen`; they are
    empty where none was asked for.
    """

    bags: tuple[BagResult, ...]
    result: FleetResult
    diagnoses: tuple[RobotDiagnosis, ...] = ()


def identify_fleet(run: FleetRun, progress: Progress | None = None) -> Fleet:
    """Identify every bag of a fleet, and say what they say together; see `identify_bags`."""
    bags = identify_bags(run, progress)
    if progress is not None:
        progress("comparing the robots", 1.0)
    return Fleet(bags, fleet_result(bags))


def diagnose_fleet(run: FleetRun, progress: Progress | None = None) -> Fleet:
    """Identify every bag, then diagnose the robots that need it and some that represent their type.

    Parameters, errors: as `identify_bags`. What was diagnosed before is kept.
    """
    identified = identify_fleet(run, part_of(progress, 0.0, _IDENTIFIED))
    _, robots = robots_of(find_bags(run.source), Path(run.config))
    contents = {bag.uri: bag.content for bag in identified.bags}
    tasks = []
    for screened in identified.result.screen:
        robot = robots[screened.robot]
        content = "\n".join(contents[uri] for uri in screened.bags)
        key = key_of(content, robot.digest, code_version(), "diagnose")
        tasks.append((key, (screened.bags, robot)))
    rest = part_of(progress, _IDENTIFIED, 1.0)
    stage = ("diagnosing", "robots")
    answers = run.answers(DIAGNOSES, GapResult, diagnose_task, tasks, stage, rest)
    diagnoses = []
    summaries: dict[str, GapSummary] = {}
    for screened, answer in zip(identified.result.screen, answers, strict=True):
        if isinstance(answer, str):
            diagnoses.append(RobotDiagnosis(screened, None, answer))
        else:
            diagnoses.append(RobotDiagnosis(screened, answer))
            summaries |= dict.fromkeys(screened.bags, gap_summary(answer))
    bags = tuple(replace(bag, diagnosis=summaries.get(bag.uri)) for bag in identified.bags)
    return Fleet(bags, fleet_result(bags), tuple(diagnoses))


def diagnose_task(uris: Sequence[str], robot: Robot) -> GapResult | str:
    """Diagnose bags of one robot together, on a worker; or why they cannot be.

    The bags are read whole, those that are far away by their index.

    Raises
    ------
    OSError
        Their store does not answer: later it may.
    """
    try:
        return diagnose([open_bag(uri) for uri in uris], robot.local())
    except IdimError as error:
        return str(error)


def gap_summary(gap: GapResult) -> GapSummary:
    """Return a diagnosis in short; a cause whose numbers may all be zero is none."""
    causes = (
        CauseSummary(c.effect, c.kind, c.joint, c.parameters, c.torque_gap.shrinkage)
        for c in gap.causes
    )
    return GapSummary(gap.verdict, tuple(c for c in causes if not is_nothing(c)), gap.summary)
