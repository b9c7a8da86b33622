"""`idim-iv replay` as a user sees it."""

import json
from pathlib import Path

import pytest

from tests.cli.conftest import refused, write_arm
from tests.simulators.test_replay import OTHER


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
    done = run("replay", short, "--config", config(), "--effects", effects, "--out", out)
    assert done.status == 0, done.error
    for word in ("nominal", "with effects", "noise", "joint_2", "mrad", "N m", "Report:"):
        assert word in done.out, done.out
    document = json.loads((out / "replay.json").read_text())
    assert document["format"] == "idim_iv_ros/replay/1"
    assert [stage["stage"] for stage in document["stages"]] == ["nominal", "with effects"]
    page = (out / "report.html").read_text()
    assert "once more, in MuJoCo" in page and "joint_2" in page
    again = run("replay", short, "--config", config(), "--json")
    assert again.status == 0 and json.loads(again.out)["model"] == "urdf"


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
