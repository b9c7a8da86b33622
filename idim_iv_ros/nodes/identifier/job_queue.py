"""Jobs one after the other, each in a worker process of its own."""

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
from idim_iv_ros.nodes.identifier.job import WAITING, Job
from idim_iv_ros.nodes.identifier.settings import REFUSE, IdentifierSettings

Event = dict[str, Any]

_START = "from idim_iv_ros.nodes.identifier.identification_worker import main; main()"


class Worker:
    """The process of one job.

    Parameters
    ----------
    request : mapping
        See `identification_worker`.
    folder : Path
        Its working directory and place for temporary files.
    heard : callable
        Takes each event in a thread of its own; the last is ``{"ended": exit status}``.
    """

    def __init__(
        self, request: Mapping[str, object], folder: Path, heard: Callable[[Event], None]
    ) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-c", _START],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            cwd=folder,
            env={**os.environ, "TMPDIR": str(folder)},
            start_new_session=True,
        )
        self._heard = heard
        self._thread = threading.Thread(target=self._listen, name="worker", daemon=True)
        self._thread.start()
        self._say(request)

    @property
    def process_id(self) -> int:
        """Of the process."""
        return self._process.pid

    def kill(self) -> None:
        """End the process and what it started, now."""
        if self._process.poll() is None:
            try:
                os.killpg(self._process.pid, signal.SIGKILL)
            except ProcessLookupError:
                return

    def join(self) -> None:
        """Wait until the process has ended and all of its events were heard."""
        self._thread.join()

    def _say(self, request: Mapping[str, object]) -> None:
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(json.dumps(request) + "\n")
            self._process.stdin.flush()
        except OSError:
            return  # it has ended already, which the other thread hears

    def _listen(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            try:
                self._heard(json.loads(line))
            except ValueError:
                continue  # cut off by a kill
        status = self._process.wait()
        if self._process.stdin is not None:
            with contextlib.suppress(OSError):
                self._process.stdin.close()
        self._process.stdout.close()
        self._heard({"ended": status})


class JobQueue:
    """At most one worker at a time; everything but `wake` happens in the thread of `poll`.

    Parameters
    ----------
    settings : callable
        The parameters as they are now.
    wake : callable
        Called in any thread when `poll` has something to do.
    ended : callable
        Takes each job when all is over.
    """

    def __init__(
        self,
        settings: Callable[[], IdentifierSettings],
        wake: Callable[[], None],
        ended: Callable[[Job], None],
    ) -> None:
        self._settings, self._wake, self._ended = settings, wake, ended
        self._waiting: deque[Job] = deque()
        self._over: deque[Job] = deque()
        self._events: queue.SimpleQueue[Event] = queue.SimpleQueue()
        self._worker: Worker | None = None
        self._begun = 0.0
        self.running: Job | None = None

    @property
    def waiting(self) -> int:
        """Jobs that are not worked on yet."""
        return len(self._waiting)

    @property
    def process_id(self) -> int | None:
        """Of the worker."""
        return None if self._worker is None else self._worker.process_id

    def submit(self, job: Job) -> None:
        """Work on a job now or later.

        Raises
        ------
        UsageError
            Another is worked on and `when_busy` says refuse, or too many wait.
        """
        settings = self._settings()
        if self.running is not None or self._waiting:
            if settings.when_busy == REFUSE:
                raise UsageError("busy with another job; when_busy is refuse")
            if len(self._waiting) >= settings.queue_limit:
                raise UsageError(f"busy: {len(self._waiting)} jobs wait already")
        self._waiting.append(job)
        job.listener.progress(WAITING, 0.0)
        self._wake()

    def cancel(self, job: Job) -> None:
        """End a job; the next `poll` says so."""
        self._abandon(job, "cancelled")
        job.cancelled = True

    def poll(self) -> None:
        """Hear the worker, end what takes too long, begin the next."""
        while True:
            try:
                self._hear(self._events.get_nowait())
            except queue.Empty:
                break
        self._end_what_is_late(time.monotonic())
        while self.running is None and self._waiting:
            self._begin(self._waiting.popleft())
        while self._over:
            self._ended(self._over.popleft())

    def end_all(self, why: str) -> None:
        """End all jobs; the next `poll` says so."""
        for job in (*self._waiting, *([self.running] if self.running else [])):
            self._abandon(job, why)

    def close(self) -> None:
        """End all jobs."""
        self.end_all("the identifier was shut down")
        if self._worker is not None:
            self._worker.join()
        self.poll()

    def _end_what_is_late(self, now: float) -> None:
        for place, job in enumerate(tuple(self._waiting)):
            if job.answer_within is not None and now > job.received + job.answer_within:
                before = place + (self.running is not None)
                jobs = "1 job was" if before == 1 else f"{before} jobs were"
                self._abandon(job, f"not begun within {job.answer_within:g} s: {jobs} before it")
        running = self.running
        if running is None:
            return
        if now > self._begun + running.timeout:
            self._abandon(running, f"ended after {running.timeout:g} s without a result")
        elif running.answer_within is not None and now > running.received + running.answer_within:
            self._abandon(running, f"ended after {running.answer_within:g} s without a result")

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
        settings = self._settings()
        source = job.configuration.source
        try:
            folder = _new_folder(Path(settings.output_directory), job.task)
            request = {
                "task": job.task,
                "bags": [str(bag) for bag in job.bags],
                "configuration": job.configuration.model_dump(mode="json", exclude_unset=True),
                "source": None if source is None else str(source),
                "topics": job.configuration.own_topics,
                "estimator": job.estimator,
                "without": job.without,
                "out": str(folder),
                "memory_limit": settings.memory_limit,
                "file_limit": settings.max_bag_size,
            }
            job.folder = folder
            self._worker = Worker(request, folder, self._put)
        except OSError as error:
            job.message = f"cannot be begun: {error.strerror or error}"
            self._finish(job)
            return
        self.running, job.stage = job, "starting"
        self._begun = time.monotonic()
        job.listener.started()

    def _put(self, event: Event) -> None:
        self._events.put(event)
        self._wake()

    def _hear(self, event: Event) -> None:
        job = self.running
        assert job is not None
        if "stage" in event:
            job.stage = str(event["stage"])
            job.listener.progress(job.stage, float(event["progress"]))
        elif "ended" in event:
            job.message = job.message or _untimely(int(event["ended"]))
            self.running = self._worker = None
            self._finish(job)
        elif not job.message:  # neither cancelled nor too late
            job.success = "message" in event
            job.message = str(event["message" if job.success else "error"])

    def _finish(self, job: Job) -> None:
        if not job.success and job.folder is not None:
            shutil.rmtree(job.folder, ignore_errors=True)
            job.folder = None
        self._over.append(job)


def _untimely(status: int) -> str:
    if status < 0:
        return f"the worker was ended by {signal.Signals(-status).name}"
    return f"the worker ended with status {status}"


def _new_folder(directory: Path, task: str) -> Path:
    """Make a folder that is named by task and time."""
    directory.mkdir(parents=True, exist_ok=True)
    stamp = time.strftime(f"{task}_%Y_%m_%d-%H_%M_%S")
    for number in range(1, 1000):
        folder = directory.resolve() / (stamp if number == 1 else f"{stamp}_{number}")
        try:
            folder.mkdir()
            return folder
        except FileExistsError:
            continue
    raise FileExistsError(f"{stamp}: too many folders")
