"""The task's scorer by itself, on answers whose figures are plain."""

import csv
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks import measurement, sensitivity
from benchmarks.fleet.arms import TYPE, payload
from benchmarks.fleet.make import make
from benchmarks.public_task import score
from benchmarks.public_task.__main__ import ANSWERS, LABELS, label_rows, our_rows
from idim_iv_ros import load_configuration
from idim_iv_ros.diagnosis import settings
from idim_iv_ros.errors import DataError
from idim_iv_ros.model import build_inverse_model
from idim_iv_ros.recording import read_recordings

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


def test_a_small_fleet_has_bags_a_manifest_and_the_truth(tmp_path: Path) -> None:
    make(tmp_path, robots=2, bags=2, seconds=3.0)
    truth = json.loads((tmp_path / "truth.json").read_text(encoding="utf-8"))
    with (tmp_path / "manifest.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 4 and len({row["time"] for row in rows}) == 4
    assert len(truth["corrupt"]) == 1
    joints = load_configuration(tmp_path / "arm2.yaml").robot.joints
    for row in rows:
        if row["uri"] in truth["corrupt"]:
            with pytest.raises(DataError):
                read_recordings([tmp_path / row["uri"]], joints=joints)
        else:
            (recording,) = read_recordings([tmp_path / row["uri"]], joints=joints)
            assert recording.duration == pytest.approx(3.0, abs=0.01)


def test_a_payload_changes_the_base_parameters_as_a_body_on_the_last_link_does() -> None:
    configuration = load_configuration(Path(__file__).parents[2] / "config" / "arm2.yaml")
    urdf = configuration.robot.urdf
    assert urdf is not None
    model = build_inverse_model(configuration, urdf.read_text(encoding="utf-8"), urdf.name)
    layout = model.regressor.layout
    x, z, mass = 0.34, 0.03, 0.5
    body = dict.fromkeys((parameter.name for parameter in layout.parameters), 0.0)
    body.update(M2=mass, MX2=mass * x, MZ2=mass * z, XX2=mass * z**2, ZZ2=mass * x**2)
    body.update(YY2=mass * (x**2 + z**2), XZ2=-mass * x * z)
    vector = np.array([body[parameter.name] for parameter in layout.parameters])
    expected = dict(zip(model.base.names, model.base.from_standard(vector), strict=True))
    for name in TYPE:
        assert payload(mass, x, z).get(name, 0.0) == pytest.approx(expected[name], abs=1e-12)


def test_what_was_argued_by_hand_outlives_new_figures(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(measurement, "RESULTS", tmp_path)
    measurement.write_page("speed", "Speed", ["first figures"])
    page = tmp_path / "speed.md"
    with page.open("a") as file:
        file.write(f"\n{measurement.BY_HAND}\n\n## Reasons\n\nBecause.\n")
    for figures in ("second figures", "third figures"):
        measurement.write_page("speed", "Speed", [figures])
        text = page.read_text()
        assert figures in text and "first" not in text
        assert text.endswith("## Reasons\n\nBecause.\n") and text.count("Because") == 1
        assert "read again" in capsys.readouterr().out


def test_a_setting_is_changed_for_a_while_and_what_came_before_it_is_kept() -> None:
    before = settings.LEAST_SUPPORT
    with sensitivity.changed("LEAST_SUPPORT", 2.0 * before):
        assert 2.0 * before == settings.LEAST_SUPPORT
    assert settings.LEAST_SUPPORT is before
    assert sensitivity.first_step("MEASURED_BELOW") == "refit"
    assert sensitivity.first_step("WORDS_OF_SUMMARY") == "conclusion"


def test_every_setting_is_read_somewhere() -> None:
    assert [name for name, files in sensitivity.readers().items() if not files] == []
