"""The process that identifies or diagnoses: a request on stdin, events on stdout, JSON lines.

Events: ``{"stage": text, "progress": 0 to 1}``, then ``{"message": verdict}`` or
``{"error": one line}``. It ends when its stdin is closed, so that it never outlives its node.
"""

import json
import os
import resource
import sys
import threading
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from idim_iv_ros.configuration import Configuration
from idim_iv_ros.diagnosis.result import GapResult
from idim_iv_ros.errors import IdimError, UsageError, one_line
from idim_iv_ros.identification.identify import identify
from idim_iv_ros.progress import Progress
from idim_iv_ros.report import write_gap_report, write_report

_FEEDBACK_PERIOD = 0.05  # s
_NO_ROOM = "failed to map segment"  # of a library that is loaded when the memory is used up
_NICE = 5  # recorder and controllers on the same machine come first

Send = Callable[[Mapping[str, object]], None]


def main() -> None:
    """Do the one request and end."""
    events = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)  # what libraries print is no event

    def send(event: Mapping[str, object]) -> None:
        events.write(json.dumps(event) + "\n")
        events.flush()

    request = json.loads(sys.stdin.readline())
    threading.Thread(target=_end_with_the_node, daemon=True).start()
    os.nice(_NICE)
    try:
        send({"message": _work(request, send)})
    except IdimError as error:
        send({"error": " ".join(str(error).split())})
    except Exception as error:
        if isinstance(error, MemoryError) or _NO_ROOM in str(error):
            send({"error": "not enough memory: see memory_limit; use fewer or shorter bags"})
        else:
            send({"error": f"defect in idim_iv_ros ({one_line(error)})"})


def _end_with_the_node() -> None:
    sys.stdin.read()
    os._exit(1)


def _work(request: Mapping[str, Any], send: Send) -> str:
    for limit, name in (("RLIMIT_DATA", "memory_limit"), ("RLIMIT_FSIZE", "file_limit")):
        kind = getattr(resource, limit)
        hard = resource.getrlimit(kind)[1]
        value = request[name] if hard == resource.RLIM_INFINITY else min(request[name], hard)
        resource.setrlimit(kind, (value, hard))
    configuration = Configuration.model_validate(request["configuration"])
    source = request["source"]
    configuration = configuration.model_copy(update={"source": Path(source) if source else None})
    configuration = configuration.with_own_topics(request["topics"])
    last: tuple[str, float] = ("", 0.0)

    def progress(stage: str, share: float) -> None:
        nonlocal last
        if stage != last[0] or time.monotonic() - last[1] > _FEEDBACK_PERIOD:
            last = (stage, time.monotonic())
            send({"stage": stage, "progress": share})

    work = {"identification": _identify, "diagnosis": _diagnose}[request["task"]]
    return work(request, configuration, progress)


def _identify(request: Mapping[str, Any], configuration: Configuration, progress: Progress) -> str:
    result = identify(
        [Path(bag) for bag in request["bags"]],
        configuration,
        estimator=request["estimator"],
        progress=progress,
    )
    progress("writing", 1.0)
    write_report(result, Path(request["out"]))
    return result.verdict.sentence


def _diagnose(request: Mapping[str, Any], configuration: Configuration, progress: Progress) -> str:
    # Here, so that an identification does not load them.
    from idim_iv_ros.diagnosis.diagnose import diagnose
    from idim_iv_ros.effects.registry import EFFECTS

    for name in request["without"]:
        if name not in EFFECTS:
            raise UsageError(f"without: {name!r} is no effect; there are {', '.join(EFFECTS)}")
    result: GapResult = diagnose(
        [Path(bag) for bag in request["bags"]],
        configuration,
        without=tuple(request["without"]),
        progress=progress,
    )
    progress("writing", 1.0)
    write_gap_report(result, Path(request["out"]))
    return " ".join(result.summary.split())
