"""What must not be seen of one run of the command line on a bad input."""

import json
import re
import signal
from pathlib import Path

from tests.command_line import SECONDS, Outcome

MEMORY = 1 << 30
_STATUSES = (0, 1, 2)
_COMPLETE = {"identify": {"result.json", "report.html"}, "diagnose": {"gap.json", "report.html"}}
_PROGRAM = "idim-iv: "
_WARNING = "Warning: "  # ours; those of libraries begin with the path of a module
# What `shown_progress` leaves on stderr: "5 s: simulating seed 1, 30 %".
_PROGRESS = re.compile(r"^\d+ s: .{1,200}, \d+ %$")
_USAGE_PANEL = re.compile(r"^(Usage: idim-iv|Try 'idim-iv|[╭│╰])")
# What tells on stdout why the status is not 0: help, and the table or the document of `check`.
_SHOWN = ("Usage: idim-iv", "not usable", '"usable": false')
_FORBIDDEN = ("Traceback", "defect in", "not enough memory")


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


def answer_faults(arguments: list[str], status: int, out: str) -> list[str]:
    """What is on stdout although --quiet or --json, as the last option, was asked for."""
    if "Usage: idim-iv" in out:
        return []
    if arguments[-1:] == ["--quiet"] and out:
        return [f"on stdout in spite of --quiet: {out[:200]}"]
    if arguments[-1:] != ["--json"] or (status and not out):
        return []
    return _json_faults("stdout", out)


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
            defects += _json_faults(name, (folder / name).read_text(encoding="utf-8"))
    return defects


def _json_faults(name: str, text: str) -> list[str]:
    def refuse(constant: str) -> None:
        raise ValueError(constant)

    try:
        json.loads(text, parse_constant=refuse)
    except ValueError as error:
        return [f"{name} is not JSON: {error}"]
    return []
