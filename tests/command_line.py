"""`idim-iv`, and programs, in forked processes of one that has everything loaded.

Imports and compiled kernels are paid for once. ``python -m tests.command_line`` reads one JSON
request a line on stdin and answers with one line: status (negative: the signal that ended it),
seconds of computation, bytes of memory. What was written is in ``stdout`` and ``stderr`` of the
folder ``log``.
"""

import gc
import json
import os
import resource
import signal
import subprocess
import sys
import time
import traceback
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
SECONDS = 20.0  # of computation that a command may take
_PATIENCE = 10.0  # times these seconds by the clock
_PROTECTION = 4 << 30  # bytes of addresses; a command fails long before, at its memory


@dataclass(frozen=True)
class Outcome:
    """What a user sees, and what the machine gave: seconds and bytes."""

    status: int
    out: str
    error: str
    seconds: float
    memory: int


class CommandLine:
    """The process that forks; its messages are as wide as `columns`."""

    def __init__(self, logs: Path, *, columns: int) -> None:
        environment = {**os.environ, "COLUMNS": str(columns), "OPENBLAS_NUM_THREADS": "1"}
        environment["PYTHONPATH"] = str(ROOT)
        environment.pop("IDIM_IV_TRACEBACK", None)
        self._logs = logs
        self._server = subprocess.Popen(
            [sys.executable, "-m", "tests.command_line"],
            cwd=ROOT,
            env=environment,
            stdin=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )

    def warm_up(self, arguments: list[str]) -> int:
        """Run a command in the process that is forked, so that what it loads is there for all."""
        return int(self._ask({"arguments": arguments, "here": True})["status"])

    def run(self, arguments: list[str], folder: Path, *, seconds: float = SECONDS) -> Outcome:
        """Run a command in a process of its own; one that takes too long is killed.

        Raises
        ------
        ValueError
            Its results would go to another place than `folder`, where they could replace a
            device or somebody's file.
        """
        for place in _places_of_results(arguments):
            if not Path(os.path.normpath(folder / place)).is_relative_to(folder):
                raise ValueError(f"results outside of {folder}: {place}")
        encoded = [os.fsencode(argument).decode("latin-1") for argument in arguments]
        return self._outcome({"arguments": encoded}, folder, seconds)

    def run_program(self, text: str, folder: Path, *, seconds: float = SECONDS) -> Outcome:
        """Run a program in Python."""
        return self._outcome({"program": text}, folder, seconds)

    def close(self) -> None:
        """End the process."""
        self._server.stdin.close()
        self._server.wait(120.0)

    def _outcome(self, request: dict, folder: Path, seconds: float) -> Outcome:
        log = {"folder": str(folder), "log": str(self._logs), "seconds": seconds}
        answer = self._ask({**request, **log})
        out, error = (
            (self._logs / name).read_text(encoding="utf-8", errors="replace")
            for name in ("stdout", "stderr")
        )
        return Outcome(answer["status"], out, error, answer["seconds"], answer["memory"])

    def _ask(self, request: dict) -> dict:
        assert self._server.stderr is not None
        self._server.stdin.write(json.dumps(request) + "\n")
        self._server.stdin.flush()
        for line in self._server.stderr:
            if line.startswith('{"status"'):
                return json.loads(line)
        raise RuntimeError("the process that runs the commands has ended")


def _places_of_results(arguments: list[str]) -> list[str]:
    """What follows --out, and the bag of an import."""
    after = [b for a, b in pairwise(arguments) if a in ("--out", "import")]
    return after + [a.partition("=")[2] for a in arguments if a.startswith("--out=")]


def serve() -> None:
    """Answer requests until stdin ends."""
    for line in sys.stdin:
        request = json.loads(line)
        if request.get("here"):
            answer = {"status": _run(request), "seconds": 0.0, "memory": 0}
        else:
            answer = _forked(request)
        print(json.dumps(answer), file=sys.__stderr__, flush=True)


def _forked(request: dict) -> dict:
    gc.freeze()
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
        status = _run(request)
    finally:
        os._exit(status)


def _run(request: dict) -> int:
    from idim_iv_ros.cli.main import main

    arguments = [os.fsdecode(text.encode("latin-1")) for text in request.get("arguments", ())]
    sys.argv = ["idim-iv", *arguments]
    try:
        if "program" in request:
            exec(compile(request["program"], "<program>", "exec"), {"__name__": "__main__"})
        else:
            main()
    except SystemExit as stopped:
        return stopped.code if isinstance(stopped.code, int) else int(stopped.code is not None)
    except Exception:
        traceback.print_exc()
        return 1
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
