"""A queue of jobs, one at a time, each in another process."""

import queue
import shutil
import signal
import time
from collections import deque
from collections.abc import Callable
from pathlib import Path

from idim_iv_ros.errors import UsageError
from idim_iv_ros.nodes.entry import new_folder_path
from idim_iv_ros.nodes.identifier.job import WAITING, Job
from idim_iv_ros.nodes.identifier.worker import Event, StartWorker, Worker
from idim_iv_ros.nodes.settings import REFUSE, IdentifierSettings

_SIGN_OF_LIFE = 1.0  # s between two progress reports to the client, at most


class JobQueue:
    """Runs one job at a time; everything but `wake` happens in the thread that calls `poll`.

    `wake` is called from any thread when `poll` has work to do, `ended` takes every job that has
    ended; `clock` is monotonic, s.
    """

    def __init__(
        self,
        settings: Callable[[], IdentifierSettings],
        wake: Callable[[], None],
        ended: Callable[[Job], None],
        clock: Callable[[], float] = time.monotonic,
        start_worker: StartWorker = Worker,
    ) -> None:
        self._settings, self._wake, self._ended = settings, wake, ended
        self._clock, self._start_worker = clock, start_worker
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
        """Queue a job.

        Raises UsageError: another job runs and `when_busy` is refuse, or too many jobs wait.
        """
        settings = self._settings()
        if self.running is not None or self._waiting:
            if settings.when_busy == REFUSE:
                raise UsageError("busy with another job; when_busy is refuse")
            if len(self._waiting) >= settings.queue_limit:
                raise UsageError(f"busy: {len(self._waiting)} jobs wait already")
        self._waiting.append(job)
        job.received = self._clock()
        job.say(WAITING, 0.0, job.received)
        self._wake()

    def cancel(self, job: Job) -> None:
        """Cancel a job; the next `poll` reports its end."""
        self._abandon(job, "cancelled")
        job.cancelled = True

    def poll(self) -> None:
        """Handle events of the worker, end jobs that are too late, begin the next job."""
        while True:
            try:
                self._handle_event(*self._events.get_nowait())
            except queue.Empty:
                break
        now = self._clock()
        self._end_what_is_late(now)
        for job in self._jobs:
            if now > job.said_at + _SIGN_OF_LIFE:  # nothing was heard of it for a while
                job.say(job.stage, job.share, now)
        while self.running is None and self._waiting:
            self._begin(self._waiting.popleft())
        while self._over:
            self._ended(self._over.popleft())

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
        running = self.running
        if running is None:
            return
        limits = ((self._begun, running.timeout), (running.received, running.answer_within))
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
            self._wake()

    def _begin(self, job: Job) -> None:
        """Create the folder of a job and start its worker."""
        settings = self._settings()
        try:
            folder = new_folder_path(Path(settings.output_directory).resolve(), job.task)
            folder.mkdir(parents=True)
            request = {
                "task": job.task,
                "bags": job.bags,
                "configuration": job.configuration,
                "estimator": job.estimator,
                "without": job.without,
                "out": folder,
                "memory_limit": settings.memory_limit,
                "file_limit": settings.max_bag_size,
            }
            job.folder = folder
            self._worker = self._start_worker(request, self._queue_event)
        except OSError as error:
            job.message = f"cannot be begun: {error.strerror or error}"
            self._finish(job)
            return
        self.running, job.stage = job, "starting"
        self._begun = self._clock()
        job.listener.started()

    def _queue_event(self, worker: Worker, event: Event) -> None:
        self._events.put((worker, event))
        self._wake()

    def _handle_event(self, worker: Worker, event: Event) -> None:
        """Take what a worker tells of the running job: a stage, its answer, or that it has ended.

        What an earlier worker tells late is nothing of this job's.
        """
        job = self.running
        if worker is not self._worker or job is None:
            return
        if "gone" in event:
            self._worker = None
            self._worker_ended(int(event["gone"]))
        elif "stage" in event:
            job.say(str(event["stage"]), float(event["progress"]), self._clock())
        elif not job.message:  # neither cancelled nor late
            job.success = "message" in event
            job.message = str(event["message" if job.success else "error"])

    def _worker_ended(self, status: int) -> None:
        """Finish the running job, whose process has ended with an exit status."""
        job, self.running = self.running, None
        assert job is not None
        how = f"by {signal.Signals(-status).name}" if status < 0 else f"with status {status}"
        verb = "was ended" if status < 0 else "ended"
        job.message = job.message or f"the worker {verb} {how}"
        self._finish(job)

    def _finish(self, job: Job) -> None:
        if not job.success and job.folder is not None:
            shutil.rmtree(job.folder, ignore_errors=True)
            job.folder = None
        self._over.append(job)
