"""One requested identification or diagnosis, and the checks of what a request may name."""

import math
import stat
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from idim_iv_ros.configuration import Configuration, load_configuration
from idim_iv_ros.errors import UsageError
from idim_iv_ros.nodes.settings import IdentifierSettings

WAITING = "waiting"
Task = Literal["identification", "diagnosis"]
DIAGNOSIS: Task = "diagnosis"

_LONGEST = 1000  # characters of a name
ESTIMATORS = ("idim-iv", "idim-ls")


@dataclass(frozen=True)
class JobListener:
    """Callbacks of the client of a job: when it begins, while it runs, and when it has ended.

    `progress` takes the stage and the share done, 0 to 1. `ended` is always called: with whether
    there is a result, and with the verdict or the reason of the failure.
    """

    ended: Callable[[bool, str], None]
    started: Callable[[], None] = lambda: None
    progress: Callable[[str, float], None] = lambda stage, share: None


@dataclass(eq=False)
class Job:
    """One request and its state. Times are those of the queue's clock, s.

    `bags` are absolute paths inside the bag directory, `names` relative to it. `timeout` limits the
    work, `answer_within` the time since receipt, s. `configuration_name` is as in the request;
    empty for the node's configuration. `estimator` belongs to an identification, `without` (effects
    that are not considered) to a diagnosis. `folder` holds the files of the job; None before it
    runs and after it failed. `message` is the verdict or the reason of the failure. `said_at` is
    the time of the last progress report.
    """

    task: Task
    bags: tuple[Path, ...]
    names: tuple[str, ...]
    configuration: Configuration
    timeout: float
    listener: JobListener
    answer_within: float = math.inf
    received: float = 0.0
    configuration_name: str = ""
    estimator: str = ""
    without: tuple[str, ...] = ()
    folder: Path | None = None
    message: str = ""
    success: bool = False
    cancelled: bool = False
    stage: str = WAITING
    share: float = 0.0
    said_at: float = 0.0

    def say(self, stage: str, share: float, now: float) -> None:
        """Report the stage and the share done to the client of the job."""
        self.stage, self.share, self.said_at = stage, share, now
        self.listener.progress(stage, share)


def requested_job(
    task: Task,
    request: Any,
    settings: IdentifierSettings,
    configuration: Configuration | None,
    listener: JobListener,
) -> Job:
    """Return the job that a goal or a service request asks for.

    `request` has `bags`, `configuration`, `timeout`, and `estimator` or `without`, whose effects
    the worker checks; `configuration` is the node's.

    Raises UsageError: a name leads out of its folder, a file is missing or too large, the estimator
    is unknown, or the timeout is not a valid time.
    """
    estimator = getattr(request, "estimator", "") or ESTIMATORS[0]
    without = getattr(request, "without", ())
    if estimator not in ESTIMATORS:
        raise UsageError(f"estimator {estimator!r} is neither {' nor '.join(ESTIMATORS)}")
    root = Path(settings.bag_directory)
    if not request.bags:
        raise UsageError("name at least one bag")
    bags = [confined_bag(root, name) for name in request.bags]
    size = sum(size for _, size in bags)
    if size > settings.max_bag_size:
        raise UsageError(
            f"the bags have {size / 1e6:.3g} MB; max_bag_size is {settings.max_bag_size / 1e6:.3g}"
        )
    if not math.isfinite(request.timeout) or request.timeout < 0.0:
        raise UsageError(f"timeout: {request.timeout} s is no time")
    if configuration is None:
        raise UsageError("no robot is configured: set the parameter configuration")
    if request.configuration:
        folder, what = Path(settings.configuration).parent, "the folder of the configuration"
        configuration = load_configuration(confined(folder, request.configuration, what))
    return Job(
        task=task,
        bags=tuple(path for path, _ in bags),
        names=tuple(str(path.relative_to(root.resolve())) for path, _ in bags),
        configuration=configuration,
        timeout=settings.job_timeout,
        listener=listener,
        answer_within=request.timeout or math.inf,
        configuration_name=request.configuration,
        estimator=estimator if task == "identification" else "",
        without=tuple(dict.fromkeys(without)),
    )


def confined(folder: Path, name: str, what: str) -> Path:
    """Return the resolved path of a file or folder that a request names, inside `folder`.

    `name` is relative to the folder, or absolute and inside it; `what` is the parameter that holds
    the folder, for the message.

    Raises UsageError: the name is empty, contains ``..``, or leads out of the folder.
    """
    if len(name) > _LONGEST:
        raise UsageError(f"{what}: a name of {len(name)} characters is too long")
    if not name or "\0" in name:
        raise UsageError(f"{name!r} names no file in {what}")
    if ".." in Path(name).parts:
        raise UsageError(f"{name}: '..' is not allowed; name a file in {what}")
    path = _resolve(folder / name, name)
    if not path.is_relative_to(_resolve(folder, what)):
        raise UsageError(f"{name}: leads out of {what}")
    return path


def confined_bag(folder: Path, name: str) -> tuple[Path, int]:
    """Return the path of a bag that a request names, and its size in bytes.

    Raises UsageError: as `confined`; or the bag, or a file of it, does not exist, leads out of the
    folder, or is no regular file.
    """
    path = confined(folder, name, "bag_directory")
    root = _resolve(folder, "bag_directory")
    try:
        files: Iterable[Path] = path.iterdir() if path.is_dir() else [path]
        return path, sum(_size(file, root, name) for file in files)
    except FileNotFoundError as error:
        raise UsageError(f"{name}: no such bag in bag_directory") from error
    except OSError as error:
        raise UsageError(f"{name}: cannot be read: {error.strerror or error}") from error


def _size(file: Path, root: Path, name: str) -> int:
    """Return the bytes of a file of the bag `name`, which must be a regular one inside `root`."""
    if not _resolve(file, name).is_relative_to(root):
        raise UsageError(f"{name}: its file {file.name} leads out of bag_directory")
    status = file.stat()
    if stat.S_ISDIR(status.st_mode):
        return 0  # no part of a bag: it is never read
    if not stat.S_ISREG(status.st_mode):
        raise UsageError(f"{name}: its file {file.name} is no regular file")
    return status.st_size


def _resolve(path: Path, name: str) -> Path:
    try:
        return path.resolve()
    except (OSError, RuntimeError) as error:  # too long, or a link to itself
        raise UsageError(f"{name}: no such file") from error
