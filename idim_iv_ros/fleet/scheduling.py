"""Tasks on Dask: a cluster of this machine or any that runs already, a few tasks ahead."""

import itertools
import logging
import os
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from typing import Any

from idim_iv_ros.errors import UsageError, one_line
from idim_iv_ros.fleet.content import code_version
from idim_iv_ros.fleet.remote import INSTALL
from idim_iv_ros.interruption import undone_if_interrupted

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
    """Connect to a running scheduler, or start workers on this machine and end them again.

    Raises
    ------
    UsageError
        Dask is not installed, the scheduler does not answer or has no worker, or its workers run
        another version of this program.
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
    """Refuse workers of another version, or without this program; lost ones are passed over."""
    for answer in client.run(code_version, on_error="return").values():
        if isinstance(answer, str):
            _require_version(client, answer)
        elif not isinstance(answer, OSError):
            raise UsageError(
                f"--scheduler {client.scheduler.address}: its workers cannot run idim_iv_ros "
                f"({one_line(answer)}); install the same version there"
            )


def _require_version(client: Any, version: str) -> None:
    """Refuse a worker that runs another version than this machine."""
    if version != (here := code_version()):
        where = (
            f"--scheduler {client.scheduler.address}: workers run {version}, this machine {here}"
        )
        raise UsageError(f"{where}; install the same version everywhere")


@dataclass(frozen=True)
class OtherVersion:
    """What a worker answers that runs another version: it may have come after the first look."""

    version: str


def of_version(version: str, function: Callable[..., Any], *arguments: Any) -> Any:
    """Call a function, on a worker; `OtherVersion` where the worker runs another one."""
    return function(*arguments) if code_version() == version else OtherVersion(code_version())


def run_tasks(
    client: Any,
    function: Callable[..., Any],
    arguments: Sequence[tuple[Any, ...]],
    done: Callable[[int, Any, str], None],
) -> None:
    """Call a function once for each tuple of arguments, in no order.

    `done` is called here with the place among the arguments, and what the function returned, or
    None and why there is nothing.

    Raises
    ------
    UsageError
        A worker runs another version of this program.
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
            if isinstance(answer, OtherVersion):
                _require_version(client, answer.version)
        elif future.status == "error":
            error = future.exception()
            if isinstance(error, (ImportError, AttributeError)):  # of a worker that came later?
                _require_same_version(client)
            died = isinstance(error, KilledWorker)
            why = "its worker died each time (out of memory?)" if died else one_line(error)
        else:
            why = "the task was cancelled"
        done(place, answer, why)
        future.release()
        submit(max(1, ahead() - len(places)))
