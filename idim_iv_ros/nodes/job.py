"""One identification that was asked for, and who asked."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from idim_iv_ros.configuration import Configuration

WAITING = "waiting"


@dataclass(frozen=True)
class JobListener:
    """Who asked for a job.

    Attributes
    ----------
    started : callable
        Called when the work begins.
    progress : callable
        Takes the stage and the share done, 0 to 1.
    ended : callable
        Takes, in any case, whether there is a result, and the verdict or why there is none.
    """

    started: Callable[[], None]
    progress: Callable[[str, float], None]
    ended: Callable[[bool, str], None]


@dataclass(eq=False)
class Job:
    """One request.

    Attributes
    ----------
    bags : tuple of Path
        Absolute, inside the bag directory.
    names : tuple of str
        The same, relative to it.
    configuration : Configuration
    estimator : str
    timeout : float
        s, from the start of the work.
    listener : JobListener
    folder : Path or None
        Of its files; None before it is worked on and after it failed.
    message : str
        Verdict, or why there is none.
    success, cancelled : bool
    stage : str
        What is done now.
    """

    bags: tuple[Path, ...]
    names: tuple[str, ...]
    configuration: Configuration
    estimator: str
    timeout: float
    listener: JobListener
    folder: Path | None = None
    message: str = ""
    success: bool = False
    cancelled: bool = False
    stage: str = WAITING
