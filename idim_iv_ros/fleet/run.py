"""A run over a fleet: its settings, earlier answers on disk, and its tasks on Dask."""

import itertools
import logging
import os
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from idim_iv_ros.documents import Document
from idim_iv_ros.encoding import json_text
from idim_iv_ros.errors import UsageError, one_line
from idim_iv_ros.files import FilePath, refused_if_unwritable, write_together
from idim_iv_ros.fleet.robots import code_version
from idim_iv_ros.fleet.source import INSTALL
from idim_iv_ros.interruption import said_if_interrupted, undone_if_interrupted
from idim_iv_ros.progress import Progress

D = TypeVar("D", bound=Document)


@dataclass(frozen=True)
class FleetRun:
    """Settings of one run over the bags of a fleet.

    Raises
    ------
    UsageError
        Scheduler and workers are both given, or no worker.
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
        self,
        function: Callable[..., Any],
        arguments: Sequence[tuple[Any, ...]],
        done: Callable[[int, Any, str], None],
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
        """Return the answers of a function to all tasks; earlier answers are read from disk.

        A task is the key under which its answer is kept, and the arguments of the function. This
        returns a document of `kind`, which becomes a file in `folder` below `out`, or the reason
        why there is none; then another run tries again. `stage` names the activity and its objects:
        ``("identifying", "bags")``. The answers are in the order of the tasks.

        Raises
        ------
        UsageError
            An answer cannot be written, or as `run_tasks`.
        """
        paths = [Path(self.out) / folder / f"{key}.json" for key, _ in tasks]
        answers: list[D | str] = [_earlier_answer(kind, path) or "" for path in paths]
        waiting = [place for place, answer in enumerate(answers) if not answer]
        total, count, begin = len(waiting), 0, time.monotonic()

        def report() -> None:
            if progress is not None and waiting:
                words = _progress_words(stage, count, total, time.monotonic() - begin)
                progress(words, count / total)

        def done(number: int, answer: D | str | None, why: str) -> None:
            nonlocal count
            place = waiting[number]
            answers[place] = answer or why
            if isinstance(answer, Document):
                path = paths[place]
                with refused_if_unwritable(path):
                    path.parent.mkdir(parents=True, exist_ok=True)
                    write_together({path: json_text(answer.to_document(), indent=None)})
            count += 1
            report()

        def interrupted() -> str:
            words = f"{count:,} of {total:,} {stage[1]} are done and kept"
            return f"{words}; the same command goes on from there"

        report()
        with said_if_interrupted(interrupted):
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


_WAIT = 60  # s for the first worker of a running scheduler
# Tasks that wait at each thread: it is never idle, and what travels stays small.
_AHEAD = 2
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


@contextmanager
def connected(scheduler: str | None = None, workers: int | None = None) -> Iterator[Any]:
    """Connect to a running scheduler, or start workers on this machine for a ``with`` block.

    Raises UsageError: Dask is not installed, the scheduler does not answer or has no worker, or its
    workers run another version of this program.
    """
    try:
        import dask
        from distributed import Client, LocalCluster
    except ImportError as error:
        raise UsageError(INSTALL) from error
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
    for answer in client.run(of_version, code_version(), str, on_error="return").values():
        if isinstance(answer, UsageError):
            raise UsageError(f"{where}: {answer}")
        if isinstance(answer, Exception) and not isinstance(answer, OSError):
            raise UsageError(
                f"{where}: its workers cannot run idim_iv_ros ({one_line(answer)}); install the "
                "same version there"
            )


def of_version(version: str, function: Callable[..., Any], *arguments: Any) -> Any:
    """Call a function on a worker, whose version is checked first: it may have joined late.

    Raises UsageError: the worker runs another version.
    """
    if (other := code_version()) != version:
        words = f"workers run {other}, this machine {version}"
        raise UsageError(f"{words}; install the same version everywhere")
    return function(*arguments)


def run_tasks(
    client: Any,
    function: Callable[..., Any],
    arguments: Sequence[tuple[Any, ...]],
    done: Callable[[int, Any, str], None],
) -> None:
    """Call a function on workers once for each tuple of arguments, in no particular order.

    `done` is called in this process with the place among the arguments, and the returned value or
    None, and the error.

    Raises UsageError: a worker runs another version of this program.
    """
    from distributed import KilledWorker, as_completed

    waiting = iter(enumerate(arguments))
    places: dict[str, int] = {}
    finished = as_completed()

    def submit(count: int) -> None:
        for place, values in itertools.islice(waiting, count):
            future = client.submit(
                of_version, code_version(), function, *values, pure=False, retries=_RETRIES
            )
            places[future.key] = place
            finished.add(future)

    def ahead() -> int:
        """Tasks that keep all threads busy; workers may have come."""
        return max(1, _AHEAD * int(sum(client.ncores().values())))

    submit(ahead())
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
        submit(max(1, ahead() - len(places)))
