"""The command that writes the recording of a simulated robot."""

import json
from pathlib import Path

from tests.cli.test_bad_input import refused

CONFIG = Path(__file__).resolve().parents[2] / "config"


def test_simulated_bag_is_identified_to_its_truth(run, tmp_path: Path) -> None:
    bag = tmp_path / "arm2.mcap"
    outcome = run("simulate", "--config", CONFIG / "arm2.yaml", "--out", bag, "--duration", 8)
    assert outcome.status == 0, outcome.error
    assert "8001 samples, 8 s at 1000 Hz" in outcome.out
    truth = json.loads((tmp_path / "arm2.truth.json").read_text())
    out = tmp_path / "results"
    assert run("identify", bag, "--config", CONFIG / "arm2.yaml", "--out", out).status == 0
    result = json.loads((out / "result.json").read_text())
    off = {p["name"]: abs(p["value"] - truth[p["name"]]) / p["std"] for p in result["parameters"]}
    assert len(off) == len(truth)
    assert max(off.values()) < 4.0, off
    assert result["instruments"]["accepted"] is True


def test_designed_motion_is_simulated(run, tmp_path: Path) -> None:
    trajectory = tmp_path / "motion.csv"
    trajectory.write_text(
        "time,joint_2.position,joint_1.position\n"
        + "".join(f"{k / 100:.2f},{0.001 * k},{0.002 * k}\n" for k in range(200))
    )
    bag = tmp_path / "a.mcap"
    outcome = run(
        "simulate", "--config", CONFIG / "arm2.yaml", "--out", bag, "--trajectory", trajectory
    )
    assert outcome.status == 0, outcome.error
    assert "1991 samples" in outcome.out


def test_bad_input_is_one_line(run, tmp_path: Path) -> None:
    config, bag = CONFIG / "arm2.yaml", tmp_path / "a.mcap"
    wrong = tmp_path / "motion.csv"
    wrong.write_text("time,elbow.position\n0,0\n0.1,0\n0.2,0\n")
    refused(run("simulate", "--config", config, "--out", bag, "--trajectory", wrong), 2, "elbow")
    refused(run("simulate", "--config", CONFIG / "ur10.yaml", "--out", bag), 2, "effort_unit")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["motion.csv"]
