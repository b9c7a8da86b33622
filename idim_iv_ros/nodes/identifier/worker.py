"""The process of a job, forked from one that has loaded and rehearsed all that jobs need."""

import contextlib
import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Mapping
from multiprocessing import forkserver
from multiprocessing.connection import Connection
from typing import Any

Event = dict[str, Any]
Request = Mapping[str, object]

_LOADED = [f"{__package__}.identification_worker", f"{__package__}.rehearsed"]
_PROCESSES = multiprocessing.get_context("forkserver")
# Jobs compute in one thread; buffers of many would count for `memory_limit`.
_ONE_THREAD = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}


def warm() -> None:
    """Start the process from which jobs are forked; it loads and rehearses an identification."""
    os.environ.update(_ONE_THREAD)
    forkserver.set_forkserver_preload(_LOADED)
    with contextlib.suppress(OSError):  # the next job says why
        forkserver.ensure_running()


def _do_job(request: Request, events: Connection) -> None:
    # Here, since the node does not import what that needs.
    from idim_iv_ros.nodes.identifier.identification_worker import do_job

    do_job(request, events)


class Worker:
    """A process that carries out one job and ends.

    `heard` takes the events of `identification_worker` in a thread, at last ``{"gone": status}``.
    """

    def __init__(self, request: Request, heard: Callable[["Worker", Event], None]) -> None:
        self._events, pipe = _PROCESSES.Pipe(duplex=False)
        self._process = _PROCESSES.Process(target=_do_job, args=(request, pipe))
        self._heard, self._unwanted = heard, False
        self._thread = threading.Thread(target=self._listen, args=(pipe,), name="job", daemon=True)
        self._thread.start()

    def kill(self) -> None:
        """Kill the process and pipe children."""
        self._unwanted = True
        if self._process.pid is None:  # nobody waits until all is loaded
            self._heard(self, {"gone": -signal.SIGKILL})
            return
        self._process.kill()
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self._process.pid, signal.SIGKILL)

    def close(self) -> None:
        """Kill the process and wait until all of pipe events were handled."""
        self.kill()
        if self._process.pid is not None:
            self._thread.join()

    def _listen(self, pipe: Connection) -> None:
        """Start the process and pass on its events until it ends; then kill its children."""
        try:
            self._process.start()  # waits until all is loaded
        except (OSError, EOFError) as error:
            self._heard(self, {"error": f"cannot be begun: {error}"})
            self._heard(self, {"gone": 1})
            return
        finally:
            pipe.close()
        if self._unwanted:
            self.kill()
        with contextlib.suppress(EOFError, OSError):
            while True:
                self._heard(self, self._events.recv())
        self._process.join()
        self.kill()  # what the job started and left
        self._events.close()
        status = self._process.exitcode
        assert status is not None
        self._heard(self, {"gone": status})


StartWorker = Callable[[Request, Callable[[Worker, Event], None]], Worker]
