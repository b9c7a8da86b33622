"""What `idim-iv fleet` does: identify every bag, compare robots, and diagnose those that stand out.

Tasks run on Dask workers, maybe twice, and depend on one bag only. Robots of a type are first
compared by R factors. Only those that differ or changed are diagnosed, each from its newest bags
together, and a few ordinary ones, which show what all of the type share.
"""

from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from pathlib import Path

from idim_iv_ros.diagnosis.diagnose import diagnose
from idim_iv_ros.diagnosis.result.document import GapResult
from idim_iv_ros.errors import DataError, IdimError, UsageError
from idim_iv_ros.fleet.fleet_result import fleet_result
from idim_iv_ros.fleet.regression import bag_fields
from idim_iv_ros.fleet.result import BagResult, CauseSummary, FleetResult, GapSummary, Status
from idim_iv_ros.fleet.robots import Robot, code_version, content_of, key_of, robots_of
from idim_iv_ros.fleet.run import FleetRun
from idim_iv_ros.fleet.source import (
    BagEntry,
    StoreError,
    find_bags,
    local_path,
    open_bag,
    require_stores,
)
from idim_iv_ros.fleet.statistics.common_causes import is_nothing
from idim_iv_ros.identification.prepare import configured_request
from idim_iv_ros.progress import Progress, part_of
from idim_iv_ros.recording.bags.folder import Bag
from idim_iv_ros.recording.read import read_segments

BAGS = "bags"  # folder of the results of bags, below those of the fleet
DIAGNOSES = "diagnoses"  # folder of the diagnoses of robots, below the results of the fleet
# Share of the progress that the identification of the bags takes.
_IDENTIFIED = 0.5
# Bags whose content is read in parallel: disks and stores serve several requests.
_THREADS = 8
_WHOSE = ("uri", "content", "key", "robot", "type", "time")


def identify_bags(run: FleetRun, progress: Progress | None = None) -> tuple[BagResult, ...]:
    """Identify the bags of a fleet, in the order of the source; earlier results are reused.

    A bag that cannot be used has a result with the reason.

    Raises
    ------
    UsageError
        Source, configuration, output or scheduler are wrong.
    """
    entries, robots = robots_of(find_bags(run.source), Path(run.config))
    require_stores(entry.uri for entry in entries)
    if progress is not None:
        progress(f"looking at {len(entries):,} bags", 0.0)
    # This machine waits for disks and stores, and computes little.
    with ThreadPoolExecutor(_THREADS) as pool:
        results = list(pool.map(content_task, [entry.uri for entry in entries]))
    places, tasks = [], []
    for place, (entry, result) in enumerate(zip(entries, results, strict=True)):
        if result.status == "ok":
            robot = robots[entry.robot]
            key = key_of(result.content, robot.digest, code_version(), "identify")
            places.append(place)
            tasks.append((key, (entry.uri, result.content, key, robot)))
    stage = ("identifying", "bags")
    answers = run.answers(BAGS, BagResult, identify_task, tasks, stage, progress)
    for place, answer in zip(places, answers, strict=True):
        if isinstance(answer, str):  # the machines failed, not the bag
            answer = replace(results[place], status="unusable", reason=answer)
        results[place] = answer
    return without_repeats(map(owned_by, results, entries))


def owned_by(result: BagResult, entry: BagEntry) -> BagResult:
    """Return a result with the bag's robot, type, time and URI of the source, which may be new."""
    time = entry.time or result.time
    return replace(result, uri=entry.uri, robot=entry.robot, type=entry.type, time=time)


def without_repeats(results: Iterable[BagResult]) -> tuple[BagResult, ...]:
    """Mark repeated recordings as unusable: they would pass for repeats without any noise."""
    first: dict[str, str] = {}
    unique = []
    for result in results:
        before = first.setdefault(result.content, result.uri) if result.status == "ok" else None
        if before is not None and before != result.uri:
            about = {name: getattr(result, name) for name in _WHOSE}
            reason = f"the same recording as {before}"
            result = BagResult(**about, status="unusable", reason=reason)
        unique.append(result)
    return tuple(unique)


def content_task(uri: str) -> BagResult:
    """Return a bag with the digest of its content, or with the reason why it cannot be read.

    Raises UsageError: its store answers for none of its bags.
    """
    status: Status
    try:
        return BagResult(uri=uri, content=content_of(uri), status="ok")
    except FileNotFoundError:
        status, reason = "missing", "no such file"
    except StoreError as error:
        raise UsageError(f"{uri}: {error.strerror}") from error
    except OSError as error:
        status, reason = "unusable", error.strerror or str(error)
    except IdimError as error:
        status, reason = "corrupt", str(error).removeprefix(f"{local_path(uri)}: ")
    return BagResult(uri=uri, content="", status=status, reason=reason)


def identify_task(uri: str, content: str, key: str, robot: Robot) -> BagResult:
    """Identify one bag; if that fails, the result has the reason.

    A bag without a readable topic, or with damages, is corrupt.

    Raises OSError: its store does not answer now.
    """
    bag = Bag(Path(uri))
    try:
        bag = open_bag(uri)
        configuration = robot.local()
        segments = read_segments(bag, configured_request(configuration))
        fields = bag_fields(segments, configuration)
    except IdimError as error:
        torn = isinstance(error, DataError) and (bag.damages or not bag.topics)
        # The result has the name of the bag.
        reason = str(error).removeprefix(f"{bag.path}: ")
        fields = {"status": "corrupt" if torn else "unusable", "reason": reason}
    return BagResult(**{"uri": uri, "content": content, "key": key, "status": "ok"} | fields)


@dataclass(frozen=True)
class Fleet:
    """All results of a fleet.

    `bags` are in the order of the source. `diagnoses` have, by robot of `FleetResult.screen`, its
    diagnosis or the reason why there is none; only those made in this run have series to draw.
    """

    bags: tuple[BagResult, ...]
    result: FleetResult
    diagnoses: dict[str, GapResult | str] = field(default_factory=dict)


def identify_fleet(run: FleetRun, progress: Progress | None = None) -> Fleet:
    """Identify every bag of a fleet, and compare its robots; see `identify_bags`."""
    bags = identify_bags(run, progress)
    if progress is not None:
        progress("comparing the robots", 1.0)
    return Fleet(bags, fleet_result(bags))


def diagnose_fleet(run: FleetRun, progress: Progress | None = None) -> Fleet:
    """Identify every bag, then diagnose the robots that stand out and some typical ones.

    Parameters and errors are as for `identify_bags`. Earlier diagnoses are reused.
    """
    identified = identify_fleet(run, part_of(progress, 0.0, _IDENTIFIED))
    _, robots = robots_of(find_bags(run.source), Path(run.config))
    contents = {bag.uri: bag.content for bag in identified.bags}
    screen, tasks = identified.result.screen, []
    for screened in screen:
        robot = robots[screened.robot]
        content = "\n".join(contents[uri] for uri in screened.bags)
        key = key_of(content, robot.digest, code_version(), "diagnose")
        tasks.append((key, (screened.bags, robot)))
    rest = part_of(progress, _IDENTIFIED, 1.0)
    stage = ("diagnosing", "robots")
    answers = run.answers(DIAGNOSES, GapResult, diagnose_task, tasks, stage, rest)
    summaries: dict[str, GapSummary] = {}
    for screened, answer in zip(screen, answers, strict=True):
        if isinstance(answer, GapResult):
            summaries |= dict.fromkeys(screened.bags, gap_summary(answer))
    bags = tuple(replace(bag, diagnosis=summaries.get(bag.uri)) for bag in identified.bags)
    robots_diagnosed = (screened.robot for screened in screen)
    return Fleet(bags, fleet_result(bags), dict(zip(robots_diagnosed, answers, strict=True)))


def diagnose_task(uris: Sequence[str], robot: Robot) -> GapResult | str:
    """Diagnose bags of one robot together, on a worker; return the reason if that fails.

    Remote bags are read by their index.

    Raises OSError: their store does not answer now.
    """
    try:
        return diagnose([open_bag(uri) for uri in uris], robot.local())
    except IdimError as error:
        return str(error)


def gap_summary(gap: GapResult) -> GapSummary:
    """Return a summary of a diagnosis, without causes whose numbers may all be zero."""
    causes = (
        CauseSummary(c.effect, c.kind, c.joint, c.parameters, c.torque_gap.shrinkage)
        for c in gap.causes
    )
    return GapSummary(gap.verdict, tuple(c for c in causes if not is_nothing(c)), gap.summary)
