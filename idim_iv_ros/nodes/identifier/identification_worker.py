"""The process that does one job, forked from one in which all libraries are loaded.

Events: ``{"stage": text, "progress": 0 to 1}``, then ``{"message": verdict}`` or ``{"error":
line}``.
"""

import contextlib
import multiprocessing
import os
import resource
import signal
import tempfile
import threading
import time
from collections.abc import Callable, Mapping
from multiprocessing.connection import Connection
from typing import Any

from idim_iv_ros.diagnosis.diagnose import diagnose
from idim_iv_ros.diagnosis.result.document import GapResult
from idim_iv_ros.effects.registry import EFFECTS
from idim_iv_ros.errors import IdimError, UsageError, one_line
from idim_iv_ros.identification.identify import identify
from idim_iv_ros.identification.result import IdentificationResult
from idim_iv_ros.report.write import write_report

_FEEDBACK_PERIOD = 0.05  # s
_NO_ROOM = "failed to map segment"  # of a library that is loaded when the memory is used up

Send = Callable[[Mapping[str, object]], None]


def do_job(request: Mapping[str, Any], events: Connection) -> None:
    """Carry out one request and send its events: stages with progress, then the answer.

    When the node ends, this process and its children are killed: no job outlives the node.
    """
    node = multiprocessing.parent_process()
    assert node is not None

    def end_with_the_node() -> None:
        node.join()
        os.killpg(0, signal.SIGKILL)

    os.setsid()  # it is killed with what it started
    threading.Thread(target=end_with_the_node, daemon=True).start()
    with contextlib.suppress(BrokenPipeError):
        _answer(request, events.send)


def _answer(request: Mapping[str, Any], send: Send) -> None:
    try:
        answer = {"message": _work(request, send)}
    except Exception as error:
        words = f"defect in idim_iv_ros ({one_line(error)})"
        if isinstance(error, IdimError):
            words = " ".join(str(error).split())
        elif isinstance(error, MemoryError) or _NO_ROOM in str(error):
            words = "not enough memory: see memory_limit; use fewer or shorter bags"
        answer = {"error": words}
    send(answer)


def _work(request: Mapping[str, Any], send: Send) -> str:
    os.chdir(request["out"])
    os.environ["TMPDIR"] = tempfile.tempdir = str(request["out"])
    for limit, name in (("RLIMIT_DATA", "memory_limit"), ("RLIMIT_FSIZE", "file_limit")):
        kind = getattr(resource, limit)
        hard = resource.getrlimit(kind)[1]
        value = request[name] if hard == resource.RLIM_INFINITY else min(request[name], hard)
        resource.setrlimit(kind, (value, hard))
    last: tuple[str, float] = ("", 0.0)

    def progress(stage: str, share: float) -> None:
        nonlocal last
        if stage != last[0] or time.monotonic() - last[1] > _FEEDBACK_PERIOD:
            last = (stage, time.monotonic())
            send({"stage": stage, "progress": share})

    bags, configuration, without = (request[key] for key in ("bags", "configuration", "without"))
    result: IdentificationResult | GapResult
    if request["task"] == "identification":
        result = identify(bags, configuration, estimator=request["estimator"], progress=progress)
        answer = result.verdict.sentence
    else:
        for name in without:
            if name not in EFFECTS:
                raise UsageError(f"without: {name!r} is no effect; there are {', '.join(EFFECTS)}")
        result = diagnose(bags, configuration, without=without, progress=progress)
        answer = " ".join(result.summary.split())
    progress("writing", 1.0)
    write_report(result, request["out"], bags=bags)
    return answer
