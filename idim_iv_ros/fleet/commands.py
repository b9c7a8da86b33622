"""What `idim-iv fleet` does: identify every bag, compare robots, and diagnose those that stand out.

Tasks run on Dask workers, maybe twice, and depend on one bag only. Robots of a type are first
compared by R factors. Only those that differ or changed are diagnosed, each from its newest bags
together, and a few ordinary ones, which show what all of the type share.
"""

import itertools
import logging
import os
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TypeVar

from idim_iv_ros.diagnosis.diagnose import diagnose
from idim_iv_ros.diagnosis.result.document import GapResult
from idim_iv_ros.documents import Document
from idim_iv_ros.encoding import json_text
from idim_iv_ros.errors import DataError, IdimError, UsageError, one_line
from idim_iv_ros.files import FilePath, refused_if_unwritable, write_together
from idim_iv_ros.fleet import source
from idim_iv_ros.fleet.fleet_result import fleet_result
from idim_iv_ros.fleet.regression import bag_fields
from idim_iv_ros.fleet.result import BagResult, CauseSummary, FleetResult, GapSummary, Status
from idim_iv_ros.fleet.statistics.common_causes import is_nothing
from idim_iv_ros.identification.prepare import configured_request
from idim_iv_ros.interruption import said_if_interrupted, undone_if_interrupted
from idim_iv_ros.progress import Progress, part_of
from idim_iv_ros.recording.bags.folder import Bag
from idim_iv_ros.recording.read import read_segments

D = TypeVar("D", bound=Document)
# Of a function on a worker: the place of its arguments, what it returned or None, and the error.
Done = Callable[[int, Any, str], None]

BAGS = "bags"  # folder of the results of bags, below those of the fleet
_DIAGNOSES = "diagnoses"  # of the diagnoses of robots, likewise
_IDENTIFIED = 0.5  # share of the progress that the identification of the bags takes
_THREADS = 8  # bags whose content is read in parallel: disks and stores serve several requests
_WHOSE = ("uri", "content", "key", "robot", "type", "time")

_WAIT = 60  # s for the first worker of a running scheduler
_AHEAD = 2  # tasks that wait at each thread: it is never idle, and what travels stays small
# A task whose store did not answer is tried so often again; one whose worker died, by Dask itself.
_RETRIES = 2
# Nothing is said on a user's terminal but by this program, which reads all outcomes.
_SETTINGS = {
    "logging.distributed": "critical",
    "distributed.worker.memory.target": False,
    "distributed.worker.memory.spill": False,
    "distributed.worker.memory.pause": False,
    "distributed.worker.memory.terminate": False,
    "distributed.scheduler.allowed-failures": 3,
    # Call stacks of the last hour, which nobody looks at, would grow by 100 MB on each worker.
    "distributed.worker.profile.enabled": False,
}
# After an interruption Python's own tracker removes what is left, and would say so below our line.
_TRACKER = "ignore::UserWarning:multiprocessing.resource_tracker"


@dataclass(frozen=True)
class FleetRun:
    """Settings of one run over the bags of a fleet.

    Raises UsageError: scheduler and workers are both given, or no worker.
    """

    source: str  # manifest, folder or URL, see `find_bags`
    config: FilePath  # one configuration or a folder of them, see `robots_of`
    out: FilePath  # folder of the results; those of bags are kept in ``bags/`` below it
    scheduler: str | None = None  # address of a running Dask scheduler; None: on this machine
    workers: int | None = None  # on this machine; None: one for each core

    def __post_init__(self) -> None:
        if self.scheduler is not None and self.workers is not None:
            raise UsageError("--workers is for this machine; a running scheduler has its own")
        if self.workers is not None and self.workers < 1:
            raise UsageError(f"--workers {self.workers}: at least one is needed")

    def tasks(
        self, function: Callable[..., Any], arguments: Sequence[tuple[Any, ...]], done: Done
    ) -> None:
        """Run tasks as `run_tasks`, on Dask; without tasks nothing is started."""
        if arguments:
            with connected(self.scheduler, self.workers) as client:
                run_tasks(client, function, arguments, done)

    def answers(
        self,
        folder: str,
        kind: type[D],
        function: Callable[..., D | str],
        tasks: Sequence[tuple[str, tuple[Any, ...]]],
        stage: tuple[str, str],
        progress: Progress | None,
    ) -> list[D | str]:
        """Return the answers of a function to all tasks, in their order; earlier ones are kept.

        A task is the key of its answer, and the arguments of the function. This returns a document
        of `kind`, which becomes a file in `folder` below `out`, or the reason why there is none;
        then another run tries again. `stage` is as in ``("identifying", "bags")``.

        Raises UsageError: an answer cannot be written, or as `run_tasks`.
        """
        paths = [Path(self.out) / folder / f"{key}.json" for key, _ in tasks]
        answers: list[D | str] = [_earlier_answer(kind, path) or "" for path in paths]
        waiting = [place for place, answer in enumerate(answers) if not answer]
        count, begin = 0, time.monotonic()

        def count_words() -> str:
            return f"{count:,} of {len(waiting):,} {stage[1]}"

        def report() -> None:
            if progress is not None and waiting:
                words = _progress_words(stage, count, len(waiting), time.monotonic() - begin)
                progress(words, count / len(waiting))

        def done(number: int, answer: D | str | None, why: str) -> None:
            nonlocal count
            place = waiting[number]
            answers[place] = answer or why
            if isinstance(answer, Document):
                with refused_if_unwritable(paths[place]):
                    paths[place].parent.mkdir(parents=True, exist_ok=True)
                    write_together({paths[place]: json_text(answer.to_document(), indent=None)})
            count += 1
            report()

        report()
        kept = "are done and kept; the same command goes on from there"
        with said_if_interrupted(lambda: f"{count_words()} {kept}"):
            self.tasks(function, [tasks[place][1] for place in waiting], done)
        return answers


def _earlier_answer(kind: type[D], path: Path) -> D | None:
    """Return the answer of an earlier run; None where this version can read none."""
    try:
        return kind.from_json(path.read_text(encoding="utf-8"), str(path))
    except (FileNotFoundError, UsageError, ValueError):
        return None


def _progress_words(stage: tuple[str, str], done: int, total: int, seconds: float) -> str:
    """Return a sentence: how many are done, how fast, and how long the rest takes."""
    words = f"{stage[0]} {done:,} of {total:,} {stage[1]}"
    if not done or seconds <= 0.0:
        return words
    left = seconds / done * (total - done)
    unit, size = ("s", 1.0) if left < 100.0 else ("min", 60.0) if left < 6000.0 else ("h", 3600.0)
    return f"{words}, {60.0 * done / seconds:.3g} a minute, {left / size:.0f} {unit} left"


@contextmanager
def connected(scheduler: str | None = None, workers: int | None = None) -> Iterator[Any]:
    """Connect to a running scheduler, or start workers on this machine for a ``with`` block.

    Raises UsageError: no Dask, no answer, no worker, or workers of another version of this program.
    """
    try:
        import dask
        from distributed import Client, LocalCluster
    except ImportError as error:
        raise UsageError(source.INSTALL) from error
    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    with dask.config.set(_SETTINGS), ExitStack() as stack:
        if scheduler is None:
            folder = tempfile.TemporaryDirectory(prefix="idim_iv_dask_", ignore_cleanup_errors=True)
            stack.enter_context(folder)
            stack.enter_context(undone_if_interrupted(folder.cleanup))
            os.environ.setdefault("PYTHONWARNINGS", _TRACKER)
            cluster = LocalCluster(
                n_workers=workers,
                threads_per_worker=1,
                dashboard_address=None,
                local_directory=folder.name,
                silence_logs=logging.CRITICAL,
            )
            yield stack.enter_context(Client(stack.enter_context(cluster)))
            return
        try:
            client = stack.enter_context(Client(scheduler, timeout=f"{_WAIT} s"))
        except Exception as error:
            raise UsageError(f"--scheduler {scheduler}: {one_line(error)}") from error
        try:
            client.wait_for_workers(1, timeout=_WAIT)
        except TimeoutError as error:
            words = f"--scheduler {scheduler}: it has no worker after {_WAIT} s"
            raise UsageError(words) from error
        _require_same_version(client)
        yield client


def _require_same_version(client: Any) -> None:
    """Refuse workers of another version, or without this program; lost workers are ignored."""
    where = f"--scheduler {client.scheduler.address}"
    for answer in client.run(of_version, source.code_version(), str, on_error="return").values():
        if isinstance(answer, UsageError):
            raise UsageError(f"{where}: {answer}")
        if isinstance(answer, Exception) and not isinstance(answer, OSError):
            raise UsageError(
                f"{where}: its workers cannot run idim_iv_ros ({one_line(answer)}); install the "
                "same version there"
            )


def of_version(version: str, function: Callable[..., Any], *arguments: Any) -> Any:
    """Call a function on a worker; a UsageError where that, joined late, is of another version."""
    if (other := source.code_version()) != version:
        words = f"workers run {other}, this machine {version}"
        raise UsageError(f"{words}; install the same version everywhere")
    return function(*arguments)


def run_tasks(
    client: Any, function: Callable[..., Any], arguments: Sequence[tuple[Any, ...]], done: Done
) -> None:
    """Call a function on workers for each tuple of arguments, in no particular order.

    `done` is called in this process. Raises UsageError: a worker is of another version.
    """
    from distributed import KilledWorker, as_completed

    waiting = iter(enumerate(arguments))
    places: dict[str, int] = {}
    finished = as_completed()

    def submit() -> None:
        """Keep all threads busy; workers may have come."""
        ahead = _AHEAD * int(sum(client.ncores().values()))
        for place, values in itertools.islice(waiting, max(1, ahead - len(places))):
            future = client.submit(
                of_version, source.code_version(), function, *values, pure=False, retries=_RETRIES
            )
            places[future.key] = place
            finished.add(future)

    submit()
    for future in finished:
        place, answer, why = places.pop(future.key), None, ""
        if future.status == "finished":
            answer = future.result()
        elif future.status == "error":
            error = future.exception()
            # A worker of another version may have joined.
            if isinstance(error, (ImportError, AttributeError, UsageError)):
                _require_same_version(client)
            died = isinstance(error, KilledWorker)
            why = "its worker died each time (out of memory?)" if died else one_line(error)
        else:
            why = "the task was cancelled"
        done(place, answer, why)
        future.release()
        submit()


def identify_bags(run: FleetRun, progress: Progress | None = None) -> tuple[BagResult, ...]:
    """Identify the bags of a fleet, in the order of the source; earlier results are reused.

    A bag that cannot be used, and one that repeats another, has a result with the reason.

    Raises
    ------
    UsageError
        Source, configuration, output or scheduler are wrong.
    """
    entries, robots = source.robots_of(source.find_bags(run.source), Path(run.config))
    remote = [entry.uri for entry in entries if not source.is_local(entry.uri)]
    for uri in {uri.partition("://")[0]: uri for uri in remote}.values():
        source.file_system(uri)  # a kind of store that no library opens ends the run
    if progress is not None:
        progress(f"looking at {len(entries):,} bags", 0.0)
    # This machine waits for disks and stores, and computes little.
    with ThreadPoolExecutor(_THREADS) as pool:
        results = list(pool.map(content_task, [entry.uri for entry in entries]))
    places, tasks = [], []
    for place, (entry, result) in enumerate(zip(entries, results, strict=True)):
        if result.status == "ok":
            robot = robots[entry.robot]
            key = source.key_of(result.content, robot, "identify")
            places.append(place)
            tasks.append((key, (entry.uri, result.content, key, robot)))
    answers = run.answers(BAGS, BagResult, identify_task, tasks, ("identifying", "bags"), progress)
    for place, answer in zip(places, answers, strict=True):
        if isinstance(answer, str):  # the machines failed, not the bag
            answer = replace(results[place], status="unusable", reason=answer)
        results[place] = answer
    first: dict[str, str] = {}
    for place, (entry, result) in enumerate(zip(entries, results, strict=True)):
        results[place] = result = owned_by(result, entry)
        before = first.setdefault(result.content, result.uri) if result.status == "ok" else None
        if before not in (None, result.uri):  # it would pass for a repeat without any noise
            about = {name: getattr(result, name) for name in _WHOSE}
            reason = f"the same recording as {before}"
            results[place] = BagResult(**about, status="unusable", reason=reason)
    return tuple(results)


def owned_by(result: BagResult, entry: source.BagEntry) -> BagResult:
    """Return a result with the bag's robot, type, time and URI of the source, which may be new."""
    time = entry.time or result.time
    return replace(result, uri=entry.uri, robot=entry.robot, type=entry.type, time=time)


def content_task(uri: str) -> BagResult:
    """Return a bag with the digest of its content, or with the reason why it cannot be read.

    Raises UsageError: its store answers for none of its bags.
    """
    status: Status
    try:
        return BagResult(uri=uri, content=source.content_of(uri), status="ok")
    except FileNotFoundError:
        status, reason = "missing", "no such file"
    except source.StoreError as error:
        raise UsageError(f"{uri}: {error.strerror}") from error
    except OSError as error:
        status, reason = "unusable", error.strerror or str(error)
    except IdimError as error:
        status, reason = "corrupt", str(error).removeprefix(f"{source.local_path(uri)}: ")
    return BagResult(uri=uri, content="", status=status, reason=reason)


def identify_task(uri: str, content: str, key: str, robot: source.Robot) -> BagResult:
    """Identify one bag; if that fails, the result has the reason (corrupt where it is damaged).

    Raises OSError: its store does not answer now.
    """
    bag = Bag(Path(uri))
    try:
        bag = source.open_bag(uri)
        configuration = robot.local()
        fields = bag_fields(read_segments(bag, configured_request(configuration)), configuration)
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
    _, robots = source.robots_of(source.find_bags(run.source), Path(run.config))
    contents = {bag.uri: bag.content for bag in identified.bags}
    screen, tasks = identified.result.screen, []
    for screened in screen:
        robot = robots[screened.robot]
        content = "\n".join(contents[uri] for uri in screened.bags)
        tasks.append((source.key_of(content, robot, "diagnose"), (screened.bags, robot)))
    rest = part_of(progress, _IDENTIFIED, 1.0)
    stage = ("diagnosing", "robots")
    answers = run.answers(_DIAGNOSES, GapResult, diagnose_task, tasks, stage, rest)
    summaries: dict[str, GapSummary] = {}
    for screened, answer in zip(screen, answers, strict=True):
        if isinstance(answer, GapResult):
            summaries |= dict.fromkeys(screened.bags, gap_summary(answer))
    bags = tuple(replace(bag, diagnosis=summaries.get(bag.uri)) for bag in identified.bags)
    diagnosed = (screened.robot for screened in screen)
    return Fleet(bags, fleet_result(bags), dict(zip(diagnosed, answers, strict=True)))


def diagnose_task(uris: Sequence[str], robot: source.Robot) -> GapResult | str:
    """Diagnose bags of one robot together, on a worker; return the reason if that fails."""
    try:
        return diagnose([source.open_bag(uri) for uri in uris], robot.local())
    except IdimError as error:
        return str(error)


def gap_summary(gap: GapResult) -> GapSummary:
    """Return a summary of a diagnosis, without causes whose numbers may all be zero."""
    causes = (
        CauseSummary(c.effect, c.kind, c.joint, c.parameters, c.torque_gap.shrinkage)
        for c in gap.causes
    )
    return GapSummary(gap.verdict, tuple(c for c in causes if not is_nothing(c)), gap.summary)
