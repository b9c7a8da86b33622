"""What is asked of a fleet, where the work is done, and what is kept of it."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from idim_iv_ros.documents import Document
from idim_iv_ros.encoding import json_text
from idim_iv_ros.errors import UsageError
from idim_iv_ros.files import FilePath, write_together
from idim_iv_ros.fleet.scheduling import connected, run_tasks
from idim_iv_ros.interruption import said_if_interrupted
from idim_iv_ros.progress import Progress

D = TypeVar("D", bound=Document)


@dataclass(frozen=True)
class FleetRun:
    """One run over the bags of a fleet.

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
        """See `run_tasks`; nothing is started where there is nothing to do."""
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
        """Call a function for all tasks that earlier runs did not do, and keep what it returns.

        A task is the key under which its answer is kept, and the arguments of the function. This
        returns a document of `kind`, which becomes a file in `folder` below `out`, or says why
        there is none; then another run tries again. `stage` says in words what is done and to
        what: ``("identifying", "bags")``. The answers are in the order of the tasks.

        Raises
        ------
        UsageError
            An answer cannot be written, or as `run_tasks`.
        """
        paths = [Path(self.out) / folder / f"{key}.json" for key, _ in tasks]
        answers: list[D | str] = [_read(kind, path) or "" for path in paths]
        waiting = [place for place, answer in enumerate(answers) if not answer]
        total, count, begin = len(waiting), 0, time.monotonic()

        def report() -> None:
            if progress is not None and waiting:
                words = _words(stage, count, total, time.monotonic() - begin)
                progress(words, count / total)

        def done(number: int, answer: D | str | None, why: str) -> None:
            nonlocal count
            place = waiting[number]
            answers[place] = answer or why
            if isinstance(answer, Document):
                _write(answer, paths[place])
            count += 1
            report()

        def interrupted() -> str:
            words = f"{count:,} of {total:,} {stage[1]} are done and kept"
            return f"{words}; the same command goes on from there"

        report()
        with said_if_interrupted(interrupted):
            self.tasks(function, [tasks[place][1] for place in waiting], done)
        return answers


def _read(kind: type[D], path: Path) -> D | None:
    """Return what an earlier run kept; None where there is nothing that this version can read."""
    try:
        return kind.from_json(path.read_text(encoding="utf-8"), str(path))
    except (FileNotFoundError, UsageError, ValueError):
        return None


def _write(answer: Document, path: Path) -> None:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_together({path: json_text(answer.to_document(), indent=None)})
    except OSError as error:
        raise UsageError(f"{path}: cannot be written: {error.strerror or error}") from error


def _words(stage: tuple[str, str], done: int, total: int, seconds: float) -> str:
    """Say how many are done, how fast, and how long the rest takes."""
    words = f"{stage[0]} {done:,} of {total:,} {stage[1]}"
    if not done or seconds <= 0.0:
        return words
    left = seconds / done * (total - done)
    unit, size = ("s", 1.0) if left < 100.0 else ("min", 60.0) if left < 6000.0 else ("h", 3600.0)
    return f"{words}, {60.0 * done / seconds:.3g} a minute, {left / size:.0f} {unit} left"
