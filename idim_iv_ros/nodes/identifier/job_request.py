"""From a request to a job: what it names is checked before anything is done."""

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from idim_iv_ros.configuration import Configuration, load_configuration
from idim_iv_ros.errors import UsageError
from idim_iv_ros.nodes.confined_paths import confined, confined_bag
from idim_iv_ros.nodes.identifier.job import Job, JobListener, Task
from idim_iv_ros.nodes.identifier.settings import IdentifierSettings

_MOST_BAGS, _MOST_EFFECTS = 1000, 100
RequestedJob = Callable[[Any, IdentifierSettings, Configuration | None, JobListener], Job]
ESTIMATORS = ("idim-iv", "idim-ls")


def requested_identification(
    request: Any,
    settings: IdentifierSettings,
    configuration: Configuration | None,
    listener: JobListener,
) -> Job:
    """Return the job of an Identify request, a goal or a service request.

    Parameters
    ----------
    request
        With `bags`, `configuration`, `estimator` and `timeout`.
    settings
    configuration
        The node's own.
    listener
        Who asks.

    Raises
    ------
    UsageError
        A name leads out of its folder, a file is missing or too large, the estimator is unknown
        or the timeout is no time.
    """
    estimator = request.estimator or ESTIMATORS[0]
    if estimator not in ESTIMATORS:
        raise UsageError(f"estimator {estimator!r} is neither {' nor '.join(ESTIMATORS)}")
    job = _job("identification", request, settings, configuration, listener)
    return replace(job, estimator=estimator)


def requested_diagnosis(
    request: Any,
    settings: IdentifierSettings,
    configuration: Configuration | None,
    listener: JobListener,
) -> Job:
    """Return the job of a Diagnose request, a goal or a service request.

    Parameters
    ----------
    request
        With `bags`, `configuration`, `without` and `timeout`.
    settings
    configuration
        The node's own.
    listener
        Who asks.

    Raises
    ------
    UsageError
        As `requested_identification`; effects are looked up by the worker.
    """
    if len(request.without) > _MOST_EFFECTS:
        raise UsageError(f"without: {len(request.without)} effects; at most {_MOST_EFFECTS}")
    job = _job("diagnosis", request, settings, configuration, listener)
    return replace(job, without=tuple(dict.fromkeys(request.without)))


def _job(
    task: Task,
    request: Any,
    settings: IdentifierSettings,
    configuration: Configuration | None,
    listener: JobListener,
) -> Job:
    root = Path(settings.bag_directory)
    if not request.bags:
        raise UsageError("name at least one bag")
    if len(request.bags) > _MOST_BAGS:
        raise UsageError(f"{len(request.bags)} bags; at most {_MOST_BAGS}")
    bags = [confined_bag(root, name) for name in request.bags]
    size = sum(each for _, each in bags)
    if size > settings.max_bag_size:
        raise UsageError(
            f"the bags have {size / 1e6:.3g} MB; max_bag_size is {settings.max_bag_size / 1e6:.3g}"
        )
    if not math.isfinite(request.timeout) or request.timeout < 0.0:
        raise UsageError(f"timeout: {request.timeout} s is no time")
    return Job(
        task=task,
        bags=tuple(path for path, _ in bags),
        names=tuple(str(path.relative_to(root.resolve())) for path, _ in bags),
        configuration=_configuration(request.configuration, settings, configuration),
        timeout=min(request.timeout or settings.job_timeout, settings.job_timeout),
        listener=listener,
    )


def _configuration(
    name: str, settings: IdentifierSettings, own: Configuration | None
) -> Configuration:
    if own is None:
        raise UsageError("no robot is configured: set the parameter configuration")
    if not name:
        return own
    folder = Path(settings.configuration).parent
    return load_configuration(confined(folder, name, "the folder of the configuration"))
