"""Jobs one after the other, in another process that is kept ready for the next."""

import contextlib
import json
import os
import queue
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from idim_iv_ros.errors import UsageError
from idim_iv_ros.nodes.entry import new_folder_path
from idim_iv_ros.nodes.identifier.job import WAITING, Job
from idim_iv_ros.nodes.settings import REFUSE, IdentifierSettings

Event = dict[str, Any]

_START = "from idim_iv_ros.nodes.identifier.identification_worker import main; main()"
# No threads of the linear algebra: a process with threads cannot be forked safely, and the jobs
# compute in one thread anyway.
_ONE_THREAD = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}

_PATIENCE = 1.0  # s
_SIGN_OF_LIFE = 1.0  # s; who asked hears at least so often what is done


class Worker:
    """A process that is kept and does one job after the other.

    `heard` takes each event of `identification_worker` in a thread of its own, at last ``{"gone":
    exit status}``. The `process_id` is that of the present job, once it has begun; `ready` says
    that everything is loaded, `killed` that `kill` ended the process itself.
    """

    def __init__(self, heard: Callable[["Worker", Event], None]) -> None:
        self.process_id: int | None = None
        self.ready = self.killed = False
        self._process = subprocess.Popen(
            [sys.executable, "-c", _START],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env={**os.environ, **_ONE_THREAD},
            start_new_session=True,
        )
        self._heard = heard
        self._thread = threading.Thread(target=self._listen, name="worker", daemon=True)
        self._thread.start()

    def begin(self, request: Mapping[str, object]) -> None:
        """Hand over a job; none other must be under way."""
        assert self._process.stdin is not None
        with contextlib.suppress(OSError):  # it has ended already, which the other thread hears
            self._process.stdin.write(json.dumps(request) + "\n")
            self._process.stdin.flush()

    def kill(self) -> None:
        """End the job and what it started, now; the process stays if it could begin the job."""
        group = self.process_id or self._process.pid
        self.killed = group == self._process.pid
        if self._process.poll() is None:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(group, signal.SIGKILL)

    def close(self) -> None:
        """End the process and wait until all of its events were heard."""
        if self.process_id is not None:
            self.kill()
        assert self._process.stdin is not None
        with contextlib.suppress(OSError):
            self._process.stdin.close()  # it ends by itself, unless it is just starting
        try:
            self._process.wait(_PATIENCE)
        except subprocess.TimeoutExpired:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(self._process.pid, signal.SIGKILL)
        self._thread.join()

    def _listen(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            with contextlib.suppress(ValueError):  # empty, or cut off by a kill
                event = json.loads(line)
                self.process_id = event.get("began", self.process_id)
                self.ready = self.ready or "ready" in event
                if "ended" in event:
                    self.process_id = None
                self._heard(self, event)
        status = self._process.wait()
        self.process_id = None
        for pipe in (self._process.stdin, self._process.stdout):
            if pipe is not None:
                with contextlib.suppress(OSError):
                    pipe.close()
        self._heard(self, {"gone": status})


StartWorker = Callable[[Callable[[Worker, Event], None]], Worker]


class JobQueue:
    """One job at a time; everything but `wake` happens in the thread of `poll`.

    The worker process is kept from job to job. It is replaced when it has ended, and where a job
    had to be killed before the process could begin it. `wake` is called in any thread when `poll`
    has something to do, `ended` takes a job when all is over; `clock` is monotonic, s.
    """

    def __init__(
        self,
        settings: Callable[[], IdentifierSettings],
        wake: Callable[[], None],
        ended: Callable[[Job], None],
        clock: Callable[[], float] = time.monotonic,
        start_worker: StartWorker | None = None,
    ) -> None:
        self._settings, self._wake, self._ended = settings, wake, ended
        self._clock, self._start_worker = clock, start_worker or Worker
        self._waiting: deque[Job] = deque()
        self._over: deque[Job] = deque()
        self._events: queue.SimpleQueue[tuple[Worker, Event]] = queue.SimpleQueue()
        self._worker: Worker | None = None
        self._begun = 0.0
        self.running: Job | None = None

    @property
    def waiting(self) -> int:
        """Jobs that are not worked on yet."""
        return len(self._waiting)

    @property
    def process_id(self) -> int | None:
        """Of the process that does the present job."""
        return None if self._worker is None else self._worker.process_id

    @property
    def _jobs(self) -> list[Job]:
        return [*self._waiting, *([self.running] if self.running else [])]

    def warm(self) -> None:
        """Start the worker in the background, so that the first job finds it ready."""
        if self._worker is None:
            with contextlib.suppress(OSError):  # the next job says why
                self._worker = self._start_worker(self._put)

    def submit(self, job: Job) -> None:
        """Work on a job now or later.

        Raises UsageError: another is worked on and `when_busy` says refuse, or too many wait.
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
        """End a job; the next `poll` says so."""
        self._abandon(job, "cancelled")
        job.cancelled = True

    def poll(self) -> None:
        """Hear the worker, end what takes too long, begin the next."""
        while True:
            try:
                self._hear(*self._events.get_nowait())
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
        """End all jobs; the next `poll` says so."""
        for job in self._jobs:
            self._abandon(job, why)

    def close(self) -> None:
        """End all jobs."""
        self.end_all("the identifier was shut down")
        worker, self._worker = self._worker, None
        if worker is not None:
            worker.close()
        if self.running is not None:
            self._end(1)
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
        if job is self.running and self._worker is not None:
            job.message = job.message or why
            self._worker.kill()
        elif job in self._waiting:
            self._waiting.remove(job)
            job.message = why
            self._over.append(job)
            self._wake()

    def _begin(self, job: Job) -> None:
        settings, configuration = self._settings(), job.configuration
        try:
            folder = new_folder_path(Path(settings.output_directory).resolve(), job.task)
            folder.mkdir(parents=True)
            request = {
                "task": job.task,
                "bags": [str(bag) for bag in job.bags],
                "configuration": configuration.model_dump(mode="json", exclude_unset=True),
                "source": configuration.source and str(configuration.source),
                "topics": configuration.node_topics,
                "estimator": job.estimator,
                "without": job.without,
                "out": str(folder),
                "memory_limit": settings.memory_limit,
                "file_limit": settings.max_bag_size,
            }
            job.folder = folder
            self._worker = self._worker or self._start_worker(self._put)
        except OSError as error:
            job.message = f"cannot be begun: {error.strerror or error}"
            self._finish(job)
            return
        self.running, job.stage = job, "starting"
        self._begun = self._clock()
        job.listener.started()
        self._worker.begin(request)

    def _put(self, worker: Worker, event: Event) -> None:
        self._events.put((worker, event))
        self._wake()

    def _hear(self, worker: Worker, event: Event) -> None:
        if worker is not self._worker:
            return
        job = self.running
        if "gone" in event:
            self._worker = None
            if job is not None:
                self._end(int(event["gone"]))
            if worker.ready or worker.killed:  # else it would only end again
                self.warm()
        elif job is None:
            return
        elif "stage" in event:
            job.say(str(event["stage"]), float(event["progress"]), self._clock())
        elif "ended" in event:
            self._end(int(event["ended"]))
        elif event.keys() & {"message", "error"} and not job.message:  # not cancelled or late
            job.success = "message" in event
            job.message = str(event["message" if job.success else "error"])

    def _end(self, status: int) -> None:
        """Finish the running job, whose process has ended."""
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
