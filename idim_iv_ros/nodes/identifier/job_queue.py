"""Jobs one after the other, each in a process that was made ready for it."""

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
# Jobs compute in one thread; buffers of many would count for `memory_limit`.
_ONE_THREAD = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}

_SIGN_OF_LIFE = 1.0  # s; who asked hears at least so often what is done


class Worker:
    """A process that prepares for a job, does it and ends.

    `heard` takes each event of `identification_worker` in a thread of its own, at last ``{"gone":
    exit status}``.
    """

    def __init__(self, heard: Callable[["Worker", Event], None]) -> None:
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
        """Hand over the job."""
        assert self._process.stdin is not None
        with contextlib.suppress(OSError):  # it has ended already, which the other thread hears
            self._process.stdin.write(json.dumps(request) + "\n")
            self._process.stdin.flush()

    def kill(self) -> None:
        """End the process and what it started, now."""
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self._process.pid, signal.SIGKILL)

    def close(self) -> None:
        """End the process and wait until all of its events were heard."""
        self.kill()
        self._thread.join()

    def _listen(self) -> None:
        assert self._process.stdin is not None and self._process.stdout is not None
        for line in self._process.stdout:
            with contextlib.suppress(ValueError):  # cut off by a kill
                self._heard(self, json.loads(line))
        status = self._process.wait()
        self.kill()  # what the job started and left
        self._process.stdout.close()
        with contextlib.suppress(OSError):
            self._process.stdin.close()
        self._heard(self, {"gone": status})


StartWorker = Callable[[Callable[[Worker, Event], None]], Worker]


class JobQueue:
    """One job at a time; everything but `wake` happens in the thread of `poll`.

    Each job has a worker process of its own; the one for the next job prepares meanwhile. `wake` is
    called in any thread when `poll` has something to do, `ended` takes a job when all is over;
    `clock` is monotonic, s.
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
        self._next: Worker | None = None
        self._begun = 0.0
        self.running: Job | None = None

    @property
    def waiting(self) -> int:
        """Jobs that are not worked on yet."""
        return len(self._waiting)

    @property
    def _jobs(self) -> list[Job]:
        return [*self._waiting, *([self.running] if self.running else [])]

    def warm(self) -> None:
        """Start the worker of the next job, so that the job finds it ready."""
        if self._next is None:
            with contextlib.suppress(OSError):  # the next job says why
                self._next = self._start_worker(self._put)

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
        for worker in (self._worker, self._next):
            if worker is not None:
                worker.close()
        self._next = None
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
            self._worker = self._next or self._start_worker(self._put)
        except OSError as error:
            job.message = f"cannot be begun: {error.strerror or error}"
            self._finish(job)
            return
        self.running, job.stage = job, "starting"
        self._begun = self._clock()
        job.listener.started()
        self._worker.begin(request)
        self._next = None
        self.warm()

    def _put(self, worker: Worker, event: Event) -> None:
        self._events.put((worker, event))
        self._wake()

    def _hear(self, worker: Worker, event: Event) -> None:
        if worker is self._next:  # it has ended; another one would end, too
            self._next = None
        job = self.running
        if worker is not self._worker or job is None:
            return
        if "gone" in event:
            self._worker = None
            self._end(int(event["gone"]))
        elif "stage" in event:
            job.say(str(event["stage"]), float(event["progress"]), self._clock())
        elif not job.message:  # neither cancelled nor late
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
