"""What is asked of a fleet, and where the work is done."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from idim_iv_ros.errors import UsageError
from idim_iv_ros.files import FilePath
from idim_iv_ros.fleet.scheduling import connected, run_tasks


@dataclass(frozen=True)
class FleetRun:
    """One run over the bags of a fleet.

    Attributes
    ----------
    source : str
        Manifest, folder or URL, see `find_bags`.
    config : path
        Of one configuration or a folder of them, see `robots_of`.
    out : path
        Folder of the results; those of bags are kept in ``bags/`` below it.
    scheduler : str or None
        Address of a running Dask scheduler; None starts workers on this machine.
    workers : int or None
        How many on this machine; None: one for each core.

    Raises
    ------
    UsageError
        Scheduler and workers are both given, or no worker.
    """

    source: str
    config: FilePath
    out: FilePath
    scheduler: str | None = None
    workers: int | None = None

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
