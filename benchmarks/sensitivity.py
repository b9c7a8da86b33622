"""Which thresholds of the diagnosis an answer depends on.

    python -m benchmarks.sensitivity --out DIR [--cells N] [--settings NAME …]

Every threshold that was chosen on development cells (`idim_iv_ros.diagnosis.settings`) is halved
and doubled on cells of `benchmarks.withheld_effects` with two joints. The seed is not that of the
benchmark, so that no cell of it is looked at here. A share above one half is moved by its distance
from 1. Answers lie in DIR/answers, one file a cell: a run that was stopped goes on where it was,
and another one adds cells or settings. The page lists all answers that are there.

A cell is read once. A threshold of the refit needs everything again, one of the attribution keeps
the refit, and one of what comes after keeps both.
"""

import argparse
import json
import re
import shlex
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import islice, zip_longest
from pathlib import Path

from benchmarks.measurement import write_page
from benchmarks.withheld_effects.cells import Cell, all_cells, family
from benchmarks.withheld_effects.generate import cell_name, write_cell
from idim_iv_ros import load_configuration
from idim_iv_ros.compilation import one_thread
from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.diagnose import compared, concluded
from idim_iv_ros.diagnosis.refit.refit import refitted
from idim_iv_ros.identification.prepare import read_configured
from idim_iv_ros.progress import Stopwatch

SEED = 20260117
CELLS = 60
# What only these read changes what is shown beside the causes, and neither verdict nor cause.
_SHOWN = ("diagnose.py", "tracking.py", "where.py")
_REFIT = ("refit/",)
_SEARCH = ("identifiability.py", "comparison/", "answer/explained.py")

Answer = dict[str, object]


def readers() -> dict[str, list[str]]:
    """Files of the diagnosis that read each setting, by its name."""
    folder = Path(settings.__file__).parent
    files: dict[str, list[str]] = {name: [] for name in settings.all_settings()}
    for file in sorted(folder.rglob("*.py")):
        for name in dict.fromkeys(re.findall(r"\bsettings\.([A-Z][A-Z0-9_]+)", file.read_text())):
            files[name].append(str(file.relative_to(folder)))
    return files


def chosen() -> list[str]:
    """Names of the settings that were chosen by hand and can change an answer."""
    files = readers()
    return [
        name
        for name, setting in settings.all_settings().items()
        if setting.origin == settings.CHOSEN and not set(files[name]) <= set(_SHOWN)
    ]


def variants(name: str) -> tuple[float, ...]:
    """Return a setting at half and at twice its value; a large share by its distance from 1."""
    setting = settings.all_settings()[name]
    if isinstance(setting, int):
        return max(1, round(0.5 * setting)), 2 * setting
    if 0.5 < setting < 1.0:
        rest = 1.0 - setting
        return 1.0 - 0.5 * rest, 1.0 - 2.0 * rest
    return 0.5 * setting, 2.0 * setting


def first_step(name: str) -> str:
    """Return the first step of a diagnosis that reads a setting."""
    steps = [_step(file) for file in readers()[name]]
    return min(steps, key=("refit", "search", "conclusion").index)


def _step(file: str) -> str:
    if file.startswith(_REFIT):
        return "refit"
    return "search" if file.startswith(_SEARCH) else "conclusion"


@contextmanager
def changed(name: str, value: float) -> Iterator[None]:
    """Give a setting another value for a while."""
    kept = getattr(settings, name)
    setattr(settings, name, value)
    try:
        yield
    finally:
        setattr(settings, name, kept)


def answers_of(
    folder: Path, cell: Cell, wanted: list[str], answers: dict[str, Answer]
) -> Iterator[None]:
    """Diagnose a cell with every wanted setting at both values; fills `answers` one by one."""
    keys = [f"{name}={value:g}" for name in wanted for value in variants(name)]
    if set(keys) <= set(answers):
        return
    configuration = load_configuration(folder / "robot.yaml")
    without = (cell.without,) if cell.without else ()
    watch = Stopwatch(None)
    recordings = read_configured(sorted(folder.glob("*.mcap")), configuration)

    base = refitted(recordings, configuration, without)
    searched = compared(base, without)

    def answer(step: str) -> Answer:
        here = refitted(recordings, configuration, without) if step == "refit" else base
        there = searched if step == "conclusion" else compared(here, without)
        result = concluded(here, there, configuration, without, watch)
        causes = [f"{cause.effect}[{cause.joint or ''}]" for cause in result.causes]
        return {"verdict": result.verdict, "causes": causes}

    if "" not in answers:
        answers[""] = answer("conclusion")
        yield
    for name in wanted:
        for value in variants(name):
            key = f"{name}={value:g}"
            if key not in answers:
                with changed(name, value):
                    answers[key] = answer(first_step(name))
                yield


def development_cells(count: int) -> dict[str, Cell]:
    """Return so many cells by their names, one of each family in turn."""
    families: dict[str, list[tuple[str, Cell]]] = {}
    named = {cell_name(cell, SEED): cell for cell in all_cells(SEED) if cell.robot == "arm2"}
    for name, cell in sorted(named.items()):
        families.setdefault(family(cell), []).append((name, cell))
    turns = zip_longest(*(cells for _, cells in sorted(families.items())))
    return dict(islice((cell for turn in turns for cell in turn if cell is not None), count))


def run(out: Path, count: int, wanted: list[str]) -> None:
    """Write the cells and their answers that are not there yet."""
    (out / "answers").mkdir(parents=True, exist_ok=True)
    for name, cell in development_cells(count).items():
        if not (out / "cells" / name).is_dir():
            (out / "cells").mkdir(exist_ok=True)
            write_cell(out, name, cell, SEED)
        file = out / "answers" / f"{name}.json"
        answers = json.loads(file.read_text()) if file.is_file() else {}
        with one_thread():
            for _ in answers_of(out / "cells" / name, cell, wanted, answers):
                file.write_text(json.dumps(answers, indent=1) + "\n")
        print(name, cell.group, answers[""], flush=True)


def what_changes(answers: dict[str, dict[str, Answer]]) -> list[str]:
    """Lines of the page: for each setting and value, in how many cells what is another."""
    keys = [key for key in dict.fromkeys(k for of_cell in answers.values() for k in of_cell) if key]
    lines = [
        "| setting | value | tried | cells | verdict | first cause | causes | where |",
        "|---|---|---|---|---|---|---|---|",
    ]
    rows = []
    for key in keys:
        name, value = key.split("=")
        tried = {
            cell: (of_cell[""], of_cell[key]) for cell, of_cell in answers.items() if key in of_cell
        }
        verdict = sum(a["verdict"] != b["verdict"] for a, b in tried.values())
        first = sum(a["causes"][:1] != b["causes"][:1] for a, b in tried.values())
        others = {c: b for c, (a, b) in tried.items() if a != b}
        where = "; ".join(
            f"{cell[:4]}: {b['verdict']}, {', '.join(b['causes']) or 'no cause'}"
            for cell, b in others.items()
        )
        causes = sum(a["causes"] != b["causes"] for a, b in tried.values())
        value_now = f"{settings.all_settings()[name]:g}"
        row = f"| `{name}` | {value_now} | {value} | {len(tried)} | {verdict} | {first} | {causes} "
        rows.append((len(others), f"{row}| {where} |"))
    rows.sort(key=lambda row: -row[0])
    return lines + [row for _, row in rows]


def page(out: Path, command: list[str]) -> None:
    """Write benchmarks/results/sensitivity.md from all answers."""
    answers = {file.stem: json.loads(file.read_text()) for file in (out / "answers").glob("*.json")}
    answers = dict(sorted(answers.items()))
    tried = {key.split("=")[0] for of_cell in answers.values() for key in of_cell if key}
    untried = [name for name in chosen() if name not in tried]
    lines = [
        f"- arguments: `{shlex.join(command)}`",
        f"- {len(answers)} of {CELLS} cells, {len(tried)} of {len(chosen())} settings",
        "",
        *what_changes(answers),
        "",
        "## Cells, with all settings as they are",
        "",
        *(
            f"- {cell[:4]}: {unchanged['verdict']}, {', '.join(unchanged['causes']) or 'no cause'}"
            for cell, unchanged in ((cell, of_cell[""]) for cell, of_cell in answers.items())
        ),
    ]
    if untried:
        lines += ["", f"Not tried: {', '.join(f'`{name}`' for name in untried)}."]
    write_page("sensitivity", "Which thresholds the answer depends on", lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--cells", type=int, default=CELLS)
    parser.add_argument("--settings", nargs="*", choices=chosen(), default=chosen())
    given = parser.parse_args()
    run(given.out, given.cells, given.settings)
    page(given.out, sys.argv[1:])


if __name__ == "__main__":
    main()
