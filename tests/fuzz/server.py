"""Runs the command line in forked processes: imports and compiled kernels are paid for once.

Reads one JSON request a line on stdin, ``{"arguments": […], "folder": …, "seconds": …}``, and
answers with one line: status (negative: the signal that ended it), seconds of computation, bytes
of memory.
What the command wrote is in ``stdout`` and ``stderr`` of the folder ``log``.
"""

import json
import os
import resource
import signal
import sys
import time
from pathlib import Path

_PATIENCE = 2.5  # times the seconds of computation that a case may take
_PROTECTION = 4 << 30  # bytes of addresses; a case fails long before, at its memory


def serve() -> None:
    """Answer requests until stdin ends."""
    for line in sys.stdin:
        request = json.loads(line)
        if request.get("here"):
            answer = {"status": _run(request["arguments"]), "seconds": 0.0, "memory": 0}
        else:
            answer = _forked(request)
        print(json.dumps(answer), file=sys.__stderr__, flush=True)


def _forked(request: dict) -> dict:
    started = time.monotonic()
    child = os.fork()
    if child == 0:
        _child(request)
    # What computes is measured by its own time, on a busy machine too; what waits, by the clock.
    limit, in_time = started + _PATIENCE * request["seconds"], True
    pause = 0.001
    while True:
        done, status, usage = os.wait4(child, os.WNOHANG)
        if done:
            break
        if time.monotonic() > limit:
            os.kill(child, signal.SIGKILL)
            in_time = False
            _, status, usage = os.wait4(child, 0)
            break
        time.sleep(pause)
        pause = min(1.2 * pause, 0.02)
    return {
        "status": os.waitstatus_to_exitcode(status),
        "seconds": usage.ru_utime + usage.ru_stime if in_time else request["seconds"] + 1.0,
        "memory": usage.ru_maxrss * 1024,
    }


def _child(request: dict) -> None:
    status = 120
    try:
        os.chdir(request["folder"])
        for stream, name in ((1, "stdout"), (2, "stderr")):
            file = os.open(Path(request["log"]) / name, os.O_CREAT | os.O_TRUNC | os.O_WRONLY)
            os.dup2(file, stream)
        os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
        resource.setrlimit(resource.RLIMIT_AS, (_PROTECTION, _PROTECTION))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        seconds = int(request["seconds"]) + 1
        resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds))
        status = _run(request["arguments"])
    finally:
        os._exit(status)


def _run(arguments: list[str]) -> int:
    from idim_iv_ros.cli.main import main

    sys.argv = ["idim-iv", *(os.fsdecode(argument.encode("latin-1")) for argument in arguments)]
    try:
        main()
    except SystemExit as stopped:
        return stopped.code if isinstance(stopped.code, int) else int(stopped.code is not None)
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
    return 0


if __name__ == "__main__":
    sys.modules["__main__"].__package__ = ""  # or help would call the program "python -m"
    # The answers go where stderr was; what a command says in this process goes nowhere.
    sys.__stderr__ = os.fdopen(os.dup(2), "w")
    silent = os.open(os.devnull, os.O_WRONLY)
    os.dup2(silent, 1)
    os.dup2(silent, 2)
    serve()
