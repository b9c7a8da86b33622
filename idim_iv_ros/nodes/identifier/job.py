"""One identification or diagnosis that was asked for, and who asked."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from idim_iv_ros.configuration import Configuration

WAITING = "waiting"
Task = Literal["identification", "diagnosis"]


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
    task : str
        What is asked for: ``identification`` or ``diagnosis``.
    bags : tuple of Path
        Absolute, inside the bag directory.
    names : tuple of str
        The same, relative to it.
    configuration : Configuration
    estimator : str
        Of an identification.
    without : tuple of str
        Effects that a diagnosis does not consider.
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

    task: Task
    bags: tuple[Path, ...]
    names: tuple[str, ...]
    configuration: Configuration
    timeout: float
    listener: JobListener
    estimator: str = ""
    without: tuple[str, ...] = ()
    folder: Path | None = None
    message: str = ""
    success: bool = False
    cancelled: bool = False
    stage: str = WAITING
