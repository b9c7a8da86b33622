"""All bags of a fleet identified, each by itself: what `idim-iv fleet` does before statistics.

A task runs on a worker: it may run twice, and knows of no other bag.
"""

from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

from idim_iv_ros.errors import DataError, IdimError, UsageError
from idim_iv_ros.fleet.bag_result import BagResult, Status
from idim_iv_ros.fleet.content import code_version, content_of, key_of
from idim_iv_ros.fleet.regression import bag_fields
from idim_iv_ros.fleet.remote import StoreError, local_path, open_bag, require_stores
from idim_iv_ros.fleet.robots import Robot, robots_of
from idim_iv_ros.fleet.run import FleetRun
from idim_iv_ros.fleet.source import BagEntry, find_bags
from idim_iv_ros.identification.prepare import configured_request
from idim_iv_ros.progress import Progress
from idim_iv_ros.recording.bags.folder import Bag
from idim_iv_ros.recording.segments import read_segments

BAGS = "bags"  # folder of the results of bags, below those of the fleet
# Bags whose content is looked at at once: disks and stores answer several.
_THREADS = 8
_WHOSE = ("uri", "content", "key", "robot", "type", "time", "labels")


def identify_bags(run: FleetRun, progress: Progress | None = None) -> tuple[BagResult, ...]:
    """Identify every bag of a fleet that was not identified before, in the order of the source.

    A bag that cannot be used says why.

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
    """Return a result with what the source says of the bag: a kept one may have another name."""
    return replace(
        result,
        uri=entry.uri,
        robot=entry.robot,
        type=entry.type,
        time=entry.time or result.time,
        labels=dict(entry.labels),
    )


def without_repeats(results: Iterable[BagResult]) -> tuple[BagResult, ...]:
    """Leave out a recording that is there twice: it would pass for a repeat without any noise."""
    first: dict[str, str] = {}
    kept = []
    for result in results:
        before = first.setdefault(result.content, result.uri) if result.status == "ok" else None
        if before is not None and before != result.uri:
            about = {name: getattr(result, name) for name in _WHOSE}
            reason = f"the same recording as {before}"
            result = BagResult(**about, status="unusable", reason=reason)
        kept.append(result)
    return tuple(kept)


def content_task(uri: str) -> BagResult:
    """Return a bag with the digest of its content, or why it cannot be read.

    Raises
    ------
    UsageError
        Its store can be asked for no bag at all.
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
    """Identify one bag; whatever is wrong with it is in the result.

    A bag without a topic that can be read, or with damages, is corrupt.

    Raises
    ------
    OSError
        Its store does not answer: later it may.
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
