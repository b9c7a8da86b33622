"""The process that identifies and diagnoses: a request on stdin, events on stdout, JSON lines.

It loads all libraries once and rehearses; each job is then done by a child that is forked from it,
so that no job starts cold and none leaves anything behind: neither memory nor a library that was
cut off in the middle.

Events: ``{"ready": true}``; of each job ``{"began": process id}``, ``{"stage": text, "progress": 0
to 1}``, ``{"message": verdict}`` or ``{"error": one line}``, ``{"ended": exit status}``. The
process ends when its stdin is closed, and its child with it: neither outlives the node.
"""

import contextlib
import gc
import json
import os
import resource
import select
import signal
import socket
import tempfile
import threading
import time
from collections.abc import Callable, Mapping
from pathlib import Path
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
_LINK = """
  <link name="link_{0}"><inertial><origin xyz="0.2 0 0"/><mass value="2"/>
    <inertia ixx="0.01" iyy="0.03" izz="0.03" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="{0}" type="revolute"><parent link="{1}"/><child link="link_{0}"/>
    <origin xyz="{2} 0 0"/><axis xyz="0 1 0"/>
    <limit lower="-2" upper="2" velocity="6" effort="60"/></joint>"""
_URDF = (
    '<robot name="rehearsal"><link name="base"/>'
    + _LINK.format("a", "base", "0")
    + _LINK.format("b", "link_a", "0.4")
    + "</robot>"
)

Send = Callable[[Mapping[str, object]], None]


def main() -> None:
    """Do one request after the other until stdin is closed."""
    events = os.dup(1)
    os.dup2(2, 1)  # what libraries print is no event
    os.nice(_NICE)

    def send(event: Mapping[str, object]) -> None:
        # In front of it, the end of a line that a killed child did not finish.
        os.write(events, f"\n{json.dumps(event)}\n".encode())

    requests, warm = Lines(0), False
    while True:
        if not warm and not requests.waiting():
            _warm_up(requests)
            warm = True
            send({"ready": True})
        line = requests.next()
        if line is None:
            return
        _do(json.loads(line), requests, send)


def _warm_up(requests: "Lines") -> None:
    """Load everything; end at once if the node ends meanwhile."""
    ours, its = socket.socketpair()

    def watch() -> None:
        watched: list[Any] = [requests, its]
        if requests in select.select(watched, [], [])[0] and requests.ended():
            os._exit(1)

    watcher = threading.Thread(target=watch, daemon=True)
    watcher.start()
    with contextlib.suppress(Exception):  # a job that needs what is missing says so itself
        rehearse()
    ours.close()
    watcher.join()  # a process with threads cannot be forked safely
    its.close()
    gc.collect()
    gc.freeze()  # what is shared with the children is not touched by their collections


class Lines:
    """Lines of a file descriptor; whether one waits is known without waiting."""

    def __init__(self, descriptor: int) -> None:
        self._descriptor, self._read = descriptor, b""

    def waiting(self) -> bool:
        """Whether there is something to read, be it the end."""
        return b"\n" in self._read or bool(select.select([self._descriptor], [], [], 0.0)[0])

    def ended(self) -> bool:
        """Read what there is; whether that was the end."""
        part = os.read(self._descriptor, 65536)
        self._read += part
        return not part

    def fileno(self) -> int:
        """Of the descriptor, for select."""
        return self._descriptor

    def next(self) -> bytes | None:
        """Wait for a line; None at the end."""
        while b"\n" not in self._read:
            if self.ended():
                return None
        line, _, self._read = self._read.partition(b"\n")
        return line


def _do(request: Mapping[str, Any], requests: Lines, send: Send) -> None:
    """Let a child do the job, and wait for it or for the end of the node."""
    ours, its = socket.socketpair()  # either end hears when the process at the other is gone
    child = os.fork()
    if child == 0:
        ours.close()
        status = 1
        try:
            os.setsid()  # it is killed with what it started
            with Path(os.devnull).open() as nothing:
                os.dup2(nothing.fileno(), 0)
            threading.Thread(target=_end_with, args=(its,), daemon=True).start()
            send({"began": os.getpid()})
            _answer(request, send)
            status = 0
        finally:
            os._exit(status)
    its.close()
    watched: list[Any] = [ours, requests]
    while ours not in select.select(watched, [], [])[0]:
        if requests.ended():
            with contextlib.suppress(ProcessLookupError):
                os.killpg(child, signal.SIGKILL)
            watched = [ours]
    ours.close()
    status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    with contextlib.suppress(ProcessLookupError):
        os.killpg(child, signal.SIGKILL)  # what the job started and left
    send({"ended": status})


def _end_with(parent: socket.socket) -> None:
    parent.recv(1)
    os._exit(1)


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
    """Identify a bag of two simulated joints and draw the report, in a folder for a while.

    On a machine where the loops were never compiled they are compiled here.
    """
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "arm.urdf").write_text(_URDF)
        configuration = Configuration.model_validate(
            {
                "robot": {"joints": ["a", "b"], "urdf": folder / "arm.urdf"},
                "controller": {
                    "type": "pd",
                    "kp": [300.0, 100.0],
                    "kd": [20.0, 6.0],
                    "period": 1.0 / _RATE,
                },
                "signals": {"joint_states": "/joint_states", "reference": "/joint_reference"},
                "simulated_robot": {"position_noise": [1e-5] * 2, "torque_noise": [0.05] * 2},
                "processing": {"position_cutoff": 30.0},
            }
        )
        motion = random_motion(configuration, duration=_SECONDS, rate=_RATE, seed=1)
        simulate(configuration, folder / "bag.mcap", motion)
        report_html(identify([folder / "bag.mcap"], configuration))
