"""One run of the command line on a bad input, and what must not be seen of it."""

import json
import os
import re
import signal
import subprocess
import sys
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

from tests.fuzz.case import CONFIG

SECONDS = 20.0
MEMORY = 1 << 30
_STATUSES = (0, 1, 2)
_COMPLETE = {"identify": {"result.json", "report.html"}, "diagnose": {"gap.json", "report.html"}}
_PROGRAM = "idim-iv: "
_WARNING = "Warning: "  # ours; those of libraries begin with the path of a module
# What `shown_progress` leaves on stderr: "5 s: simulating seed 1, 30 %".
_PROGRESS = re.compile(r"^\d+ s: .{1,200}, \d+ %$")
_USAGE_PANEL = re.compile(r"^(Usage: idim-iv|Try 'idim-iv|[╭│╰])")
# What tells on stdout why the status is not 0: help, and the table or the document of `check`.
_SHOWN = ("Usage: idim-iv", "Not usable", '"usable": false')
_FORBIDDEN = ("Traceback", "defect in", "not enough memory")


@dataclass(frozen=True)
class Outcome:
    """What a user sees, and what the machine gave: seconds and bytes."""

    status: int
    out: str
    error: str
    seconds: float
    memory: int


class CommandLine:
    """`idim-iv` in forked processes of one that has everything loaded."""

    def __init__(self, logs: Path) -> None:
        environment = {**os.environ, "COLUMNS": "200", "OPENBLAS_NUM_THREADS": "1"}
        environment.pop("IDIM_IV_TRACEBACK", None)
        self._logs = logs
        self._server = subprocess.Popen(
            [sys.executable, "-m", "tests.fuzz.server"],
            cwd=CONFIG.parent,
            env=environment,
            stdin=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )

    def warm_up(self, arguments: list[str]) -> int:
        """Run a command in the process that is forked, so that what it loads is there for all."""
        return int(self._ask({"arguments": arguments, "here": True})["status"])

    def run(self, arguments: list[str], folder: Path) -> Outcome:
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
        answer = self._ask(
            {
                "arguments": [os.fsencode(a).decode("latin-1") for a in arguments],
                "folder": str(folder),
                "log": str(self._logs),
                "seconds": SECONDS,
            }
        )
        out, error = (
            (self._logs / name).read_text(encoding="utf-8", errors="replace")
            for name in ("stdout", "stderr")
        )
        return Outcome(answer["status"], out, error, answer["seconds"], answer["memory"])

    def close(self) -> None:
        """End the process."""
        assert self._server.stdin is not None
        self._server.stdin.close()
        self._server.wait(120.0)

    def _ask(self, request: dict) -> dict:
        assert self._server.stdin is not None
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


def faults(outcome: Outcome, *, refused: bool) -> list[str]:
    """Everything a user would call a defect, apart from files."""
    defects = []
    if outcome.seconds > SECONDS or outcome.status == -signal.SIGKILL:
        return [f"took more than {SECONDS:g} s"]
    if outcome.status not in _STATUSES:
        defects.append(f"status {outcome.status}")
    elif refused and outcome.status == 0 and "Warning" not in outcome.out + outcome.error:
        defects.append("accepted in silence")
    if outcome.memory > MEMORY:
        defects.append(f"took {outcome.memory / MEMORY:.1f} GB")
    text = outcome.out + outcome.error
    defects += [f"says {word!r}" for word in _FORBIDDEN if word in text]
    lines = [line for line in outcome.error.splitlines() if line.strip()]
    panel = [line for line in lines if _USAGE_PANEL.match(line)]
    said = [line for line in lines if line.startswith(_PROGRAM)]
    warned = [line for line in lines if line.startswith(_WARNING)]
    ours = panel + said + warned
    other = [line for line in lines if line not in ours and not _PROGRESS.match(line)]
    if other:
        defects.append(f"on stderr: {other[0][:200]}")
    shown = panel or any(words in outcome.out for words in _SHOWN)
    if outcome.status in (1, 2) and not shown and len(said) != 1:
        defects.append(f"{len(said)} lines say what is wrong")
    return defects


def files_of(folder: Path) -> dict[str, tuple[int, int]]:
    """Size and time of everything in a folder."""
    files = {}
    for path in sorted(folder.rglob("*")):
        state = path.lstat()
        files[str(path.relative_to(folder))] = (state.st_size, state.st_mtime_ns)
    return files


def file_faults(
    arguments: list[str], status: int, folder: Path, before: dict[str, tuple[int, int]]
) -> list[str]:
    """Files that are half-written, or changed by a command that was refused."""
    after = files_of(folder)
    new = {name for name in after if name not in before}
    defects = [f"left {name}" for name in new if re.search(r"\.(part|tmp)$", name)]
    changed = {n for n in before if after.get(n) != before[n] and not (folder / n).is_dir()}
    if status != 0 and new | changed:
        defects.append(f"refused, but wrote {', '.join(sorted(new | changed))}")
    complete = _COMPLETE.get(arguments[0] if arguments else "")
    if status == 0 and complete and any(n.startswith("out") for n in new):
        written = {path.name for path in (folder / "out").iterdir()}
        if written != complete:
            defects.append(f"out holds {', '.join(sorted(written))}")
    for name in new:
        if name.endswith(".json"):
            defects += _json_faults(folder / name)
    return defects


def _json_faults(path: Path) -> list[str]:
    def refuse(constant: str) -> None:
        raise ValueError(constant)

    try:
        json.loads(path.read_text(encoding="utf-8"), parse_constant=refuse)
    except ValueError as error:
        return [f"{path.name} is not JSON: {error}"]
    return []
