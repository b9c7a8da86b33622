"""The task's scorer by itself, on answers whose figures are plain."""

import csv
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from benchmarks.public_task import score
from benchmarks.public_task.__main__ import ANSWERS, LABELS, label_rows, our_rows

SCORE = Path(score.__file__)
EFFECT = {"kind": "structural", "strength": 1.0, "mass": None, "joints": []}


def _label(group: str, *effects: dict[str, Any], also: Any = ()) -> dict[str, Any]:
    filled = [{**EFFECT, "rho_recorded": 2.0, **effect} for effect in effects]
    return {"group": group, "joints": 2, "effects": filled, "also_true": list(also)}


LABEL_OF = {
    "a": _label("single", {"effect": "stribeck", "joint": "j1"}),
    "b": _label("single", {"effect": "backlash", "joint": "j2", "rho_recorded": 0.4}),
    "c": _label("none", also=({"effect": "link_inertia", "joint": None},)),
    "d": _label("payload", {"effect": "payload", "joint": "j2", "mass": 1.2}),
    "e": _label("pair", {"effect": "joint_coupling", "joint": "j1", "joints": ["j1", "j2"]},
                {"effect": "spring", "joint": "j2"}),
    "f": _label("outside", {"kind": "outside", "effect": "contact_pulses", "joint": None}),
}  # fmt: skip


def _cause(
    effect: str, joint: str | None, probability: float, mass: float | None = None
) -> dict[str, Any]:
    number = {} if mass is None else {"mass": {"value": mass, "std": 0.1}}
    return {"effect": effect, "joint": joint, "probability": probability, "parameters": number}


@pytest.fixture
def files(tmp_path: Path) -> tuple[Path, Path]:
    said = {
        "a": [_cause("stribeck", "j1", 0.95), _cause("spring", "j1", 0.65)],
        "c": [_cause("link_inertia", "j2", 0.9)],
        "d": [_cause("payload", "j1", 0.99, 1.3)],
        "e": [_cause("joint_coupling", "j2", 0.8)],
    }
    answers, labels = tmp_path / "answers.csv", tmp_path / "labels.csv"
    for path, names, rows in (
        (answers, ANSWERS, [r for n, c in said.items() for r in our_rows(n, {"causes": c})]),
        (labels, LABELS, [r for n, label in LABEL_OF.items() for r in label_rows(n, label)]),
    ):
        with path.open("w", newline="") as file:
            writer = csv.DictWriter(file, names)
            writer.writeheader()
            writer.writerows(rows)
    return answers, labels


def test_figures_are_those_of_the_answers(files: tuple[Path, Path]) -> None:
    figures = score.scores(*map(score.rows_by_recording, files))
    assert figures["one effect: all found"] == "1/1 = 100 %"  # the weak one is not asked for
    assert figures["two effects: all found"] == "0/1 = 0 %"
    assert figures["payload and friction: all found"] == "1/1 = 100 %"
    assert figures["nothing wrong, a cause named"] == "0/1 = 0 %"  # what is also true is no error
    assert figures["outside the catalogue, misnamed"] == "0/1 = 0 %"
    assert figures["mass of a payload inside its interval"] == "1/1 = 100 %"
    assert figures["false causes a recording"] == "0.17"
    # 0.95, 0.99 and 0.8 are right, 0.65 is wrong.
    brier = (0.05**2 + 0.01**2 + 0.2**2 + 0.65**2) / 4
    assert figures["Brier score"] == f"{brier:.3f}"
    assert figures["said with 50 to 70 %, true"] == "0/1 = 0 %"


def test_the_scorer_runs_without_the_package(files: tuple[Path, Path], tmp_path: Path) -> None:
    alone = tmp_path / "score.py"
    alone.write_text(SCORE.read_text())
    command = [sys.executable, "-I", "-S", str(alone), *map(str, files)]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "Brier score" in done.stdout
    files[0].write_text("recording,effect,joint\nz,spring,j1\n")
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 1
    assert "no recording z" in done.stderr
    assert done.stderr.count("\n") == 1
