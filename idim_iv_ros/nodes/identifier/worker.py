"""The node's end of the process that does the jobs; see `identification_worker`."""

import contextlib
import json
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Mapping
from typing import Any

Event = dict[str, Any]

_START = "from idim_iv_ros.nodes.identifier.identification_worker import main; main()"
# No threads of the linear algebra: a process with threads cannot be forked safely, and the jobs
# compute in one thread anyway.
_ONE_THREAD = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}

_PATIENCE = 1.0  # s


class Worker:
    """A process that is kept and does one job after the other.

    Parameters
    ----------
    heard : callable
        Takes each event in a thread of its own; the last is ``{"gone": exit status}``.

    Attributes
    ----------
    process_id : int or None
        Of the process that does the present job, once it has begun.
    ready : bool
        Whether everything is loaded.
    killed : bool
        Whether `kill` ended the process itself.

    Raises
    ------
    OSError
        No process can be started.
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
        try:
            self._process.stdin.write(json.dumps(request) + "\n")
            self._process.stdin.flush()
        except OSError:
            return  # it has ended already, which the other thread hears

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
