"""`idim-iv excite` as a user runs it."""

import json
from pathlib import Path

import numpy as np
import pytest
from ruamel.yaml import YAML

from idim_iv_ros.excitation import read_trajectory

CONFIG = Path(__file__).resolve().parents[2] / "config"
QUICK = ("--rate", 100, "--period", 6, "--harmonics", 3, "--repeats", 2)


def test_identification_writes_trajectory_message_and_figures(run, config, tmp_path: Path) -> None:
    out = tmp_path / "run.csv"
    done = run("excite", "--config", config(), "--out", out, *QUICK, status=0)
    assert "condition number" in done.out
    assert "joint_2" in done.out
    assert "ended the search" not in done.out
    assert {path.name for path in tmp_path.glob("run*")} == {"run.csv", "run.yaml", "run.json"}
    motion = read_trajectory(out)
    assert motion.joints == ("joint_1", "joint_2")
    assert motion.duration == pytest.approx(12.0)
    assert motion.rate == 100.0
    figures = json.loads((tmp_path / "run.json").read_text())
    assert figures["format"] == "idim_iv_ros/excitation/1"
    assert figures["settings"]["seed"] == 1
    assert figures["ended_early"] is False
    numbers = figures["condition_number"]
    assert numbers["designed"]["weighted"] < numbers["random_median"]["weighted"]
    assert len(figures["parameters"]) == 13
    assert max(figures["use"]["velocity"]) <= 0.9
    message = YAML(typ="safe", pure=True).load((tmp_path / "run.yaml").read_text())
    assert len(message["points"]) == 12 * 20 + 1
    np.testing.assert_allclose(message["points"][10]["positions"], motion.position[50], atol=1e-7)


def test_short_time_limit_is_admitted(run, config, tmp_path: Path) -> None:
    command = f"excite --config {config()} --out {tmp_path / 'run'} --time-limit 0.001"
    done = run(command, *QUICK, status=0)
    assert "time limit" in done.out
    assert json.loads((tmp_path / "run.json").read_text())["ended_early"] is True


def test_diagnosis_writes_its_segments(run, config, tmp_path: Path) -> None:
    out = tmp_path / "run"
    done = run(
        *("excite", "--config", config(), "--out", out, "--for", "diagnosis"),
        *("--duration", 90, "--rate", 200, "--floor", -0.2),
    )
    assert done.status == 0, done.error
    assert "stribeck" in done.out
    segments = json.loads((tmp_path / "run.json").read_text())["segments"]
    motion = read_trajectory(tmp_path / "run.csv")
    assert segments[-1]["end"] <= motion.duration <= 90.0
    starts = [segment["start"] for segment in segments]
    assert starts == sorted(starts)
    assert any("presliding" in segment["effects"] for segment in segments)


def test_robot_without_inertials_is_told_that_torques_were_not_checked(run, tmp_path: Path) -> None:
    command = f"excite --config {CONFIG / 'ur10.yaml'} --out {tmp_path / 'run'} --time-limit 0.001"
    done = run(command, *QUICK, status=0)
    assert "Torques" in done.out
    assert json.loads((tmp_path / "run.json").read_text())["limits"]["torque_checked"] is False


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (("--floor", 5), "floor 5 m cannot be kept"),
        (("--start", "0,9"), "start of joint joint_2, 9, lies outside"),
        (("--start", "0,x"), "numbers separated by commas"),
        (("--start", "0"), "1 values for 2 joints"),
        (("--time-limit", -1), "time limit -1"),
        (("--for", "diagnosis", "--duration", 5), "duration 5"),
    ],
)
def test_bad_request_is_one_line_and_leaves_nothing(run, config, tmp_path, arguments, complaint):
    folder = tmp_path / "new"
    folder.mkdir()
    done = run("excite", "--config", config(), "--out", folder / "run", *arguments, status=2)
    assert complaint in done.error
    assert len(done.error.strip().splitlines()) == 1
    assert not list(folder.iterdir())
