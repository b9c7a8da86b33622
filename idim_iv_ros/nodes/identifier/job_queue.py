"""Requested identifications and diagnoses, what they may name, and their queue."""

import math
import queue
import shutil
import signal
import stat
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from idim_iv_ros.configuration import Configuration, load_configuration
from idim_iv_ros.errors import UsageError
from idim_iv_ros.nodes.entry import new_folder_path
from idim_iv_ros.nodes.identifier.worker import Event, StartWorker, Worker
from idim_iv_ros.nodes.settings import REFUSE, IdentifierSettings

Task = Literal["identification", "diagnosis"]
ESTIMATORS = ("idim-iv", "idim-ls")

_WAITING = "waiting"
_LONGEST = 1000  # characters of a name
_SIGN_OF_LIFE = 1.0  # s between two progress reports to the client, at most


@dataclass(frozen=True)
class JobListener:
    """Callbacks of the client of a job: when it begins, while it runs, and when it has ended."""

    # Always called: whether there is a result, and the verdict or the reason of the failure.
    ended: Callable[[bool, str], None]
    started: Callable[[], None] = lambda: None
    progress: Callable[[str, float], None] = lambda stage, share: None  # 0 to 1


@dataclass(eq=False)
class Job:
    """One request and its state. Times are those of the queue's clock, s."""

    task: Task
    bags: tuple[Path, ...]  # absolute
    names: tuple[str, ...]  # relative to the bag directory
    configuration: Configuration
    timeout: float  # of the work
    listener: JobListener
    answer_within: float = math.inf  # since receipt
    received: float = 0.0
    configuration_name: str = ""  # as in the request; empty: the node's configuration
    estimator: str = ""  # of an identification
    without: tuple[str, ...] = ()  # effects that a diagnosis does not consider
    folder: Path | None = None  # of its files; None before it runs and after it failed
    message: str = ""  # the verdict, or the reason of the failure
    success: bool = False
    cancelled: bool = False
    stage: str = _WAITING
    share: float = 0.0
    said_at: float = 0.0  # when progress was reported last

    def say(self, stage: str, share: float, now: float) -> None:
        """Report the stage and the share done to the client of the job."""
        self.stage, self.share, self.said_at = stage, share, now
        self.listener.progress(stage, share)


def requested_job(
    task: Task,
    request: Any,
    settings: IdentifierSettings,
    configuration: Configuration | None,
    listener: JobListener,
) -> Job:
    """Return the job that a goal or a service request asks for.

    `request` has `bags`, `configuration`, `timeout`, and `estimator` or `without`, whose effects
    the worker checks; `configuration` is the node's. Raises UsageError: a name leads out of its
    folder, a file is missing or too large, or estimator or timeout are none.
    """
    estimator = getattr(request, "estimator", "") or ESTIMATORS[0]
    if estimator not in ESTIMATORS:
        raise UsageError(f"estimator {estimator!r} is neither {' nor '.join(ESTIMATORS)}")
    root = Path(settings.bag_directory)
    if not request.bags:
        raise UsageError("name at least one bag")
    bags = [confined_bag(root, name) for name in request.bags]
    size, most = sum(size for _, size in bags), settings.max_bag_size
    if size > most:
        raise UsageError(f"the bags have {size / 1e6:.3g} MB; max_bag_size is {most / 1e6:.3g}")
    if not math.isfinite(request.timeout) or request.timeout < 0.0:
        raise UsageError(f"timeout: {request.timeout} s is no time")
    if configuration is None:
        raise UsageError("no robot is configured: set the parameter configuration")
    if request.configuration:
        folder, what = Path(settings.configuration).parent, "the folder of the configuration"
        configuration = load_configuration(_confined(folder, request.configuration, what))
    return Job(
        task=task,
        bags=tuple(path for path, _ in bags),
        names=tuple(str(path.relative_to(root.resolve())) for path, _ in bags),
        configuration=configuration,
        timeout=settings.job_timeout,
        listener=listener,
        answer_within=request.timeout or math.inf,
        configuration_name=request.configuration,
        estimator=estimator if task == "identification" else "",
        without=tuple(dict.fromkeys(getattr(request, "without", ()))),
    )


def _confined(folder: Path, name: str, what: str) -> Path:
    """Return the path of what a request names in `folder`; `what` is the folder in words."""
    if len(name) > _LONGEST:
        raise UsageError(f"{what}: a name of {len(name)} characters is too long")
    if not name or "\0" in name:
        raise UsageError(f"{name!r} names no file in {what}")
    if ".." in Path(name).parts:
        raise UsageError(f"{name}: '..' is not allowed; name a file in {what}")
    path = _resolve(folder / name, name)
    if not path.is_relative_to(_resolve(folder, what)):
        raise UsageError(f"{name}: leads out of {what}")
    return path


def confined_bag(folder: Path, name: str) -> tuple[Path, int]:
    """Return the path of a bag that a request names, and its size in bytes.

    `name` is relative to the folder, or absolute and inside it. Raises UsageError: it leads out of
    it, or the bag or a file of it does not exist, leads out, or is no regular file.
    """
    path, size = _confined(folder, name, "bag_directory"), 0
    try:
        for file in path.iterdir() if path.is_dir() else [path]:
            if not _resolve(file, name).is_relative_to(folder.resolve()):
                raise UsageError(f"{name}: its file {file.name} leads out of bag_directory")
            status = file.stat()
            if stat.S_ISREG(status.st_mode):
                size += status.st_size
            elif not stat.S_ISDIR(status.st_mode):  # a folder is no part of a bag: it is never read
                raise UsageError(f"{name}: its file {file.name} is no regular file")
    except FileNotFoundError as error:
        raise UsageError(f"{name}: no such bag in bag_directory") from error
    except OSError as error:
        raise UsageError(f"{name}: cannot be read: {error.strerror or error}") from error
    return path, size


def _resolve(path: Path, name: str) -> Path:
    try:
        return path.resolve()
    except (OSError, RuntimeError) as error:  # too long, or a link to itself
        raise UsageError(f"{name}: no such file") from error


@dataclass(eq=False)
class JobQueue:
    """Runs one job at a time; everything but `wake` happens in the thread that calls `poll`."""

    settings: Callable[[], IdentifierSettings]
    wake: Callable[[], None]  # called from any thread when `poll` has work to do
    ended: Callable[[Job], None]  # takes every job that has ended
    clock: Callable[[], float] = time.monotonic  # s
    start_worker: StartWorker = Worker

    def __post_init__(self) -> None:
        self._waiting: deque[Job] = deque()
        self._over: deque[Job] = deque()
        self._events: queue.SimpleQueue[tuple[Worker, Event]] = queue.SimpleQueue()
        self._worker: Worker | None = None
        self._begun = 0.0
        self.running: Job | None = None

    @property
    def waiting(self) -> int:
        """Return the number of jobs that have not begun."""
        return len(self._waiting)

    @property
    def _jobs(self) -> list[Job]:
        return [*self._waiting, *([self.running] if self.running else [])]

    def submit(self, job: Job) -> None:
        """Queue a job; a UsageError where `when_busy` is refuse and one runs, or too many wait."""
        settings = self.settings()
        if self._jobs and settings.when_busy == REFUSE:
            raise UsageError("busy with another job; when_busy is refuse")
        if self.waiting >= settings.queue_limit:
            raise UsageError(f"busy: {self.waiting} jobs wait already")
        self._waiting.append(job)
        job.received = self.clock()
        job.say(_WAITING, 0.0, job.received)
        self.wake()

    def cancel(self, job: Job) -> None:
        """Cancel a job; the next `poll` reports its end."""
        self._abandon(job, "cancelled")
        job.cancelled = True

    def poll(self) -> None:
        """Handle events of the worker, end jobs that are too late, begin the next job."""
        while not self._events.empty():
            self._handle_event(*self._events.get())
        now = self.clock()
        self._end_what_is_late(now)
        for job in self._jobs:
            if now > job.said_at + _SIGN_OF_LIFE:  # nothing was heard of it for a while
                job.say(job.stage, job.share, now)
        while self.running is None and self._waiting:
            self._begin(self._waiting.popleft())
        while self._over:
            self.ended(self._over.popleft())

    def end_all(self, why: str) -> None:
        """End all jobs for the reason `why`; the next `poll` reports it."""
        for job in self._jobs:
            self._abandon(job, why)

    def close(self) -> None:
        """End all jobs and the worker process."""
        self.end_all("the identifier was shut down")
        if self._worker is not None:
            self._worker.close()
        self.poll()

    def _end_what_is_late(self, now: float) -> None:
        for place, job in enumerate(tuple(self._waiting)):
            if now > job.received + job.answer_within:
                before = place + (self.running is not None)
                jobs = "1 job was" if before == 1 else f"{before} jobs were"
                self._abandon(job, f"not begun within {job.answer_within:g} s: {jobs} before it")
        if (running := self.running) is not None:
            limits = (self._begun, running.timeout), (running.received, running.answer_within)
            over = [limit for since, limit in limits if now > since + limit]
            if over:
                self._abandon(running, f"ended after {over[0]:g} s without a result")

    def _abandon(self, job: Job, why: str) -> None:
        """Kill the worker of a running job, or remove a waiting one, for a reason."""
        if job is self.running and self._worker is not None:
            job.message = job.message or why
            self._worker.kill()
        elif job in self._waiting:
            self._waiting.remove(job)
            job.message = why
            self._over.append(job)
            self.wake()

    def _begin(self, job: Job) -> None:
        settings = self.settings()
        try:
            folder = new_folder_path(Path(settings.output_directory).resolve(), job.task)
            folder.mkdir(parents=True)
            names = ("task", "bags", "configuration", "estimator", "without")
            request = {name: getattr(job, name) for name in names} | {
                "out": folder,
                "memory_limit": settings.memory_limit,
                "file_limit": settings.max_bag_size,
            }
            job.folder = folder
            self._worker = self.start_worker(request, self._queue_event)
        except OSError as error:
            job.message = f"cannot be begun: {error.strerror or error}"
            self._finish(job)
            return
        self.running, job.stage = job, "starting"
        self._begun = self.clock()
        job.listener.started()

    def _queue_event(self, worker: Worker, event: Event) -> None:
        self._events.put((worker, event))
        self.wake()

    def _handle_event(self, worker: Worker, event: Event) -> None:
        """Take a stage, an answer or the end from the worker; nothing from an earlier worker."""
        job = self.running
        if worker is not self._worker or job is None:
            return
        if "gone" in event:
            self._worker = self.running = None
            status = int(event["gone"])
            how = f"ended with status {status}"
            if status < 0:
                how = f"was ended by {signal.Signals(-status).name}"
            job.message = job.message or f"the worker {how}"
            self._finish(job)
        elif "stage" in event:
            job.say(str(event["stage"]), float(event["progress"]), self.clock())
        elif not job.message:  # neither cancelled nor late
            job.success = "message" in event
            job.message = str(event["message" if job.success else "error"])

    def _finish(self, job: Job) -> None:
        if not job.success and job.folder is not None:
            shutil.rmtree(job.folder, ignore_errors=True)
            job.folder = None
        self._over.append(job)
