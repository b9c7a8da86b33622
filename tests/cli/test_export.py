"""A diagnosis becomes a file for a simulator, a recording is replayed in one, and MJCF is read."""

import json
import re
import sys
from pathlib import Path

import pytest

from idim_iv_ros.configuration import load_configuration
from idim_iv_ros.report.section import read_nominal
from tests.cli.conftest import CONFIG, refused, write_arm
from tests.model.test_mjcf import ARM2
from tests.simulator_files.cases import CHANGING, Case, bare, case, cause
from tests.simulators.test_replay import OTHER

FILES = ["arm2.urdf", "arm2.xml", "changes.md", "effects.json", "isaac_lab.py"]


@pytest.fixture
def arm(tmp_path: Path) -> Case:
    return case(tmp_path, "arm2", [cause("stribeck", "joint_2", excess=1.0, speed=0.2)])


def test_all_files_are_written_and_named(run, arm: Case, tmp_path: Path) -> None:
    out = tmp_path / "out"
    outcome = run("export", arm.path, "--config", CONFIG / "arm2.yaml", "--out", out, status=0)
    assert sorted(path.name for path in out.iterdir()) == FILES
    assert all(str(out / name) in outcome.out for name in FILES)
    assert "MuJoCo has no element for stribeck at joint_2: effects.json" in outcome.out
    outcome = run("export", arm.path, "--config", CONFIG / "arm2.yaml", "--out", out, "--json")
    assert sorted(Path(file).name for file in json.loads(outcome.out)["files"]) == FILES


def test_a_cause_is_left_out_by_its_name(run, arm: Case, tmp_path: Path) -> None:
    out, config = tmp_path / "out", CONFIG / "arm2.yaml"
    options = ("--config", config, "--out", out, "--without")
    refused(run("export", arm.path, *options, "payload"), 2, "no cause payload")
    assert not out.exists()
    outcome = run("export", arm.path, *options, "stribeck@joint_2")
    assert outcome.status == 0 and "no element" not in outcome.out
    assert json.loads((out / "effects.json").read_text())["effects"] == []
    assert (out / "arm2.urdf").read_bytes() == (CONFIG / "arm2.urdf").read_bytes()


def test_effects_are_simulated_with_the_exported_robot(run, arm: Case, tmp_path: Path) -> None:
    """The file goes back into `simulate`, with the URDF and the lines of changes.md."""
    out = tmp_path / "out"
    config = CONFIG / "arm2.yaml"
    assert run("export", arm.path, "--config", config, "--out", out, "--refit").status == 0
    changes = (out / "changes.md").read_text(encoding="utf-8")
    section = changes.split("```yaml\n")[1].split("```")[0]
    config = tmp_path / "new.yaml"
    robot = f"robot:\n  urdf: {out / 'arm2.urdf'}\n  joints: [joint_1, joint_2]\n"
    law = "controller: {type: pd, kp: [900.0, 200.0], kd: [40.0, 8.0], period: 0.001}\n"
    config.write_text(robot + section + law, encoding="utf-8")
    bag = tmp_path / "new.mcap"
    effects = ("--effects", out / "effects.json")
    run("simulate", "--config", config, "--out", bag, *effects, "--duration", 2, status=0)
    truth = json.loads((tmp_path / "new.truth.json").read_text())
    model, standard = arm.model, arm.standard
    for name, row in zip(model.base.names, model.base.grouping, strict=True):
        names = model.regressor.layout.names
        expected = sum(k * standard[name] for k, name in zip(row, names, strict=True))
        assert truth[name] == pytest.approx(expected, rel=1e-6, abs=1e-7)


def test_without_the_solver_one_line_says_what_to_install(run, bag, config, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "clarabel", None)
    out = tmp_path / "found"
    outcome = run("identify", bag, "--config", config(), "--out", out, status=0)
    assert "pip install 'idim-iv-ros[physical]'" in outcome.out
    assert json.loads((out / "result.json").read_text())["physical"] is None
    export = ("export", out / "result.json", "--config", config(), "--out", tmp_path / "out")
    refused(run(*export), 2, "[physical]")


def test_an_mjcf_comes_back_as_the_same_file_and_can_be_replayed(run, bag, config, tmp_path):
    """Identified, exported, and simulated with the recording that it is from."""
    configuration, results, out = as_mjcf(config, tmp_path), tmp_path / "results", tmp_path / "out"
    run("identify", bag, "--config", configuration, "--out", results, status=0)
    result = results / "result.json"
    outcome = run("export", result, "--config", configuration, "--out", out, status=0)
    names = ["arm2.xml", "changes.md", "effects.json"]
    assert sorted(path.name for path in out.iterdir()) == names
    assert all(str(out / name) in outcome.out for name in names)
    before, after = ((folder / "arm2.xml").read_text("utf-8") for folder in (tmp_path, out))
    assert after != before and bare(after, CHANGING) == bare(before, CHANGING)
    model = ("--model", out / "arm2.xml", "--effects", out / "effects.json")
    run("replay", bag, "--config", configuration, *model, "--out", tmp_path / "replayed", status=0)


@pytest.fixture(scope="session")
def short(record, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three seconds of the two-joint arm."""
    return write_arm(tmp_path_factory.mktemp("short") / "arm2.mcap", record, slice(0, 3000))


@pytest.fixture
def effects(tmp_path: Path) -> Path:
    path = tmp_path / "effects.json"
    numbers = {"excess": 1.0, "speed": 0.1}
    planted = {"effect": "stribeck", "joint": "joint_1", "parameters": numbers}
    path.write_text(json.dumps({"format": "idim_iv_ros/effects/1", "effects": [planted]}))
    return path


def test_a_replay_prints_tables_and_writes_numbers_and_page(
    run, config, short: Path, effects: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    done = run(f"replay {short} --config {config()} --effects {effects} --out {out}", status=0)
    for word in ("nominal", "with effects", "noise", "joint_2", "mrad", "N m", "Report:"):
        assert word in done.out, done.out
    document = json.loads((out / "replay.json").read_text())
    assert document["format"] == "idim_iv_ros/replay/1"
    assert [stage["stage"] for stage in document["stages"]] == ["nominal", "with effects"]
    page = (out / "report.html").read_text()
    assert "once more, in MuJoCo" in page and "joint_2" in page
    again = run("replay", short, "--config", config(), "--json", status=0)
    assert json.loads(again.out)["model"] == "urdf"


def test_what_cannot_be_replayed_is_one_line_and_nothing_is_written(
    run, config, short: Path, effects: Path, tmp_path: Path
) -> None:
    other, out = tmp_path / "other.xml", tmp_path / "out"
    other.write_text(OTHER)
    common = (short, "--config", config(), "--out", out)
    refused(run("replay", *common, "--model", other), 2, "other.xml", "no joint joint_1")
    effects.write_text(effects.read_text().replace("stribeck", "warp"))
    refused(run("replay", *common, "--effects", effects), 2, "effects.json", "warp")
    assert not out.exists()


def test_without_mujoco_one_line_names_the_extra(run, config, short, monkeypatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "mujoco", None)
    outcome = run("replay", short, "--config", config(), "--json")
    refused(outcome, 2, "a replay needs MuJoCo", "idim-iv-ros[mujoco]")


def as_mjcf(config, folder: Path) -> Path:
    """Arm2's configuration with the MJCF, which holds the armature too."""
    (folder / "arm2.xml").write_text(ARM2, encoding="utf-8")
    path = config(
        (f"urdf: {CONFIG / 'arm2.urdf'}", f"mjcf: {folder / 'arm2.xml'}"),
        ("simulator:\n  armature: [0.25, 0.1]   # kg m², joint side\n", ""),
    )
    return path.rename(folder / "mjcf.yaml")


def answer(path: Path) -> object:
    """What a diagnosis says, without times, paths and configuration."""
    document = json.loads(path.read_text())
    keys = ("verdict", "causes", "stages", "unexplained", "refit_parameters", "given_parameters")
    return {key: document[key] for key in keys if key in document}


def close(one: object, other: object) -> bool:
    """Whether two documents agree, numbers to a millionth."""
    if isinstance(one, dict) and isinstance(other, dict):
        return one.keys() == other.keys() and all(close(one[k], other[k]) for k in one)
    if isinstance(one, list) and isinstance(other, list):
        return len(one) == len(other) and all(map(close, one, other))
    if isinstance(one, float) and isinstance(other, float):
        return abs(one - other) <= 1e-6 * max(abs(one), abs(other), 1e-6)
    return one == other


def test_the_same_arm_as_urdf_and_mjcf_has_the_same_diagnosis(run, config, record, tmp_path):
    bag, answers = write_arm(tmp_path / "short.mcap", record, slice(0, 5000)), []
    for name, path in (("mjcf", as_mjcf(config, tmp_path)), ("urdf", config())):
        run("diagnose", bag, "--config", path, "--out", tmp_path / name, status=0)
        answers.append(answer(tmp_path / name / "gap.json"))
        document = json.loads((tmp_path / name / "gap.json").read_text())
        assert read_nominal(document["configuration"]).skeleton is not None
    page = (tmp_path / "mjcf" / "report.html").read_text()
    assert "joint_1@frictionloss" in page and "joint_2@armature" in page
    assert "simulator.armature[" not in page and "/dynamics@" not in page
    assert answers[0]["verdict"] == "parametric"  # type: ignore[index]
    assert close(*answers), answers


def test_a_first_configuration_names_an_mjcf_and_can_be_used(run, bag, tmp_path: Path) -> None:
    (tmp_path / "arm2.xml").write_text(ARM2, encoding="utf-8")
    out = tmp_path / "arm.yaml"
    run("init", bag, "--urdf", tmp_path / "arm2.xml", "--out", out, status=0)
    assert re.search(r"^  mjcf: arm2\.xml", out.read_text(), flags=re.MULTILINE)
    assert load_configuration(out).robot.joints == ["joint_1", "joint_2"]
    for command in ("check", "identify"):
        more = ("--out", tmp_path / command) if command == "identify" else ()
        run(command, bag, "--config", out, *more, status=0)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("  joints: [", "  mjcf: arm2.xml\n  joints: [", ("urdf", "mjcf")),
        (f"urdf: {CONFIG / 'arm2.urdf'}", "mjcf: nothing.xml", ("robot.mjcf", "nothing.xml")),
    ],
)
def test_an_mjcf_beside_a_urdf_or_that_is_missing_is_refused(run, config, bag, old, new, words):
    refused(run("check", bag, "--config", config((old, new))), 2, *words)
