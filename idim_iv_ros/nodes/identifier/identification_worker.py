"""The process that does one job: its request on stdin, events on stdout, JSON lines.

While it waits for the request it loads all libraries and rehearses, so that no job starts cold; it
ends with the job, of which nothing is left behind.

Events: ``{"stage": text, "progress": 0 to 1}``, at last ``{"message": verdict}`` or ``{"error": one
line}``. The process ends at once when its stdin is closed: it does not outlive the node.
"""

import contextlib
import json
import os
import resource
import signal
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from queue import SimpleQueue
from typing import Any

from idim_iv_ros.configuration import Configuration
from idim_iv_ros.diagnosis.diagnose import diagnose
from idim_iv_ros.effects.registry import EFFECTS
from idim_iv_ros.errors import IdimError, UsageError, one_line
from idim_iv_ros.excitation import random_motion
from idim_iv_ros.identification.identify import identify
from idim_iv_ros.report import write_report
from idim_iv_ros.report.page import report_html
from idim_iv_ros.simulators.recording import simulate

_FEEDBACK_PERIOD = 0.05  # s
_NO_ROOM = "failed to map segment"  # of a library that is loaded when the memory is used up
_NICE = 5  # recorder and controllers on the same machine come first
_RATE, _SECONDS = 500.0, 5.0  # Hz, s
_URDF = """<robot name="rehearsal"><link name="base"/>
  <link name="arm"><inertial><origin xyz="0.2 0 0"/><mass value="2"/>
    <inertia ixx="0.01" iyy="0.03" izz="0.03" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="a" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/>
    <limit lower="-2" upper="2" velocity="6" effort="60"/></joint></robot>"""

Send = Callable[[Mapping[str, object]], None]


def main() -> None:
    """Prepare, do one request, and end."""
    events = os.dup(1)
    os.dup2(2, 1)  # what libraries print is no event
    os.nice(_NICE)

    def send(event: Mapping[str, object]) -> None:
        os.write(events, f"{json.dumps(event)}\n".encode())

    requests: SimpleQueue[bytes] = SimpleQueue()
    threading.Thread(target=_listen, args=(requests,), daemon=True).start()
    if requests.empty():
        with contextlib.suppress(Exception):  # a job that needs what is missing says so itself
            rehearse()
    _answer(json.loads(requests.get()), send)
    os._exit(0)


def _listen(requests: "SimpleQueue[bytes]") -> None:
    """Take the request; at the end of the node end this process and what it started."""
    for line in sys.stdin.buffer:
        requests.put(line)
    os.killpg(0, signal.SIGKILL)


def _answer(request: Mapping[str, Any], send: Send) -> None:
    try:
        send({"message": _work(request, send)})
    except IdimError as error:
        send({"error": " ".join(str(error).split())})
    except Exception as error:
        if isinstance(error, MemoryError) or _NO_ROOM in str(error):
            send({"error": "not enough memory: see memory_limit; use fewer or shorter bags"})
        else:
            send({"error": f"defect in idim_iv_ros ({one_line(error)})"})


def _work(request: Mapping[str, Any], send: Send) -> str:
    os.chdir(request["out"])
    os.environ["TMPDIR"] = tempfile.tempdir = request["out"]
    for limit, name in (("RLIMIT_DATA", "memory_limit"), ("RLIMIT_FSIZE", "file_limit")):
        kind = getattr(resource, limit)
        hard = resource.getrlimit(kind)[1]
        value = request[name] if hard == resource.RLIM_INFINITY else min(request[name], hard)
        resource.setrlimit(kind, (value, hard))
    configuration = Configuration.model_validate(request["configuration"])
    source = request["source"]
    configuration = configuration.model_copy(update={"source": Path(source) if source else None})
    configuration = configuration.with_node_topics(request["topics"])
    last: tuple[str, float] = ("", 0.0)

    def progress(stage: str, share: float) -> None:
        nonlocal last
        if stage != last[0] or time.monotonic() - last[1] > _FEEDBACK_PERIOD:
            last = (stage, time.monotonic())
            send({"stage": stage, "progress": share})

    bags, out = [Path(bag) for bag in request["bags"]], Path(request["out"])
    if request["task"] == "identification":
        result = identify(bags, configuration, estimator=request["estimator"], progress=progress)
        progress("writing", 1.0)
        write_report(result, out, bags=bags)
        return result.verdict.sentence
    for name in request["without"]:
        if name not in EFFECTS:
            raise UsageError(f"without: {name!r} is no effect; there are {', '.join(EFFECTS)}")
    without = tuple(request["without"])
    gap = diagnose(bags, configuration, without=without, progress=progress)
    progress("writing", 1.0)
    write_report(gap, out, bags=bags)
    return " ".join(gap.summary.split())


def rehearse() -> None:
    """Identify a bag of a simulated joint and draw the report, in a folder for a while.

    On a machine where the loops were never compiled they are compiled here.
    """
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "arm.urdf").write_text(_URDF)
        configuration = Configuration.model_validate(
            {
                "robot": {"joints": ["a"], "urdf": folder / "arm.urdf"},
                "controller": {"type": "pd", "kp": [300.0], "kd": [20.0], "period": 1.0 / _RATE},
                "signals": {"joint_states": "/joint_states", "reference": "/joint_reference"},
                "simulated_robot": {"position_noise": [1e-5], "torque_noise": [0.05]},
                "processing": {"position_cutoff": 30.0},
            }
        )
        motion = random_motion(configuration, duration=_SECONDS, rate=_RATE, seed=1)
        simulate(configuration, folder / "bag.mcap", motion)
        report_html(identify([folder / "bag.mcap"], configuration))
