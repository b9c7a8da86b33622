"""The commands that make motions and recordings: simulate and excite."""

import json
from pathlib import Path

import numpy as np
import pytest
from ruamel.yaml import YAML

from idim_iv_ros.excitation.trajectory import read_trajectory
from tests.cli.conftest import CONFIG, refused
from tests.inputs import gap_content


def test_simulated_bag_is_identified_to_its_truth(run, tmp_path: Path) -> None:
    bag = tmp_path / "arm2.mcap"
    outcome = run(f"simulate --config {CONFIG / 'arm2.yaml'} --out {bag} --duration 8", status=0)
    assert "8001 samples, 8 s at 1000 Hz" in outcome.out
    truth = json.loads((tmp_path / "arm2.truth.json").read_text())
    out = tmp_path / "results"
    assert run("identify", bag, "--config", CONFIG / "arm2.yaml", "--out", out).status == 0
    result = json.loads((out / "result.json").read_text())
    off = {p["name"]: abs(p["value"] - truth[p["name"]]) / p["std"] for p in result["parameters"]}
    assert off.keys() == truth.keys() - {"format"}
    assert max(off.values()) < 4.0, off
    assert result["instruments"]["accepted"] is True


def test_designed_motion_is_simulated(run, tmp_path: Path) -> None:
    trajectory = tmp_path / "motion.csv"
    trajectory.write_text(
        "time,joint_2.position,joint_1.position\n"
        + "".join(f"{k / 100:.2f},{0.001 * k},{0.002 * k}\n" for k in range(200))
    )
    bag = tmp_path / "a.mcap"
    command = f"simulate --config {CONFIG / 'arm2.yaml'} --out {bag} --trajectory {trajectory}"
    assert "1991 samples" in run(command, status=0).out


def test_bad_input_is_one_line(run, tmp_path: Path) -> None:
    config, bag = CONFIG / "arm2.yaml", tmp_path / "a.mcap"
    wrong = tmp_path / "motion.csv"
    wrong.write_text("time,elbow.position\n0,0\n0.1,0\n0.2,0\n")
    refused(run("simulate", "--config", config, "--out", bag, "--trajectory", wrong), 2, "elbow")
    refused(run("simulate", "--config", CONFIG / "ur10.yaml", "--out", bag), 2, "effort_unit")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["motion.csv"]


def gap_file(path: Path, *causes: dict, parameters: dict | None = None, **changes) -> Path:
    path.write_text(json.dumps(gap_content(*causes, parameters=parameters) | changes))
    return path


STRIBECK = {"effect": "stribeck", "joint": "joint_2", "parameters": {"excess": 1.0, "speed": 0.2}}


def test_robot_of_a_diagnosis_has_its_parameters_and_effects(run, tmp_path: Path) -> None:
    coupling = {
        "effect": "joint_coupling", "joint": "joint_1", "other_joint": "joint_2",
        "parameters": {"direction": -1.0, "coulomb": 0.3},
    }  # fmt: skip
    payload = {"effect": "payload", "joint": "joint_2", "parameters": {"mass": 0.4}}
    gap = gap_file(
        tmp_path / "gap.json", STRIBECK, coupling, payload, parameters={"Fv2": 0.7, "off1": 0.4}
    )
    plain, bag = tmp_path / "plain.mcap", tmp_path / "a.mcap"
    common = ("--config", CONFIG / "arm2.yaml", "--duration", 2)
    assert run("simulate", *common, "--out", plain).status == 0
    run("simulate", *common, "--out", bag, "--effects", gap, status=0)
    given = json.loads((tmp_path / "plain.truth.json").read_text())
    truth = json.loads((tmp_path / "a.truth.json").read_text())
    effects = truth.pop("effects")
    assert "effects" not in given
    assert truth == given | {"Fv2": 0.7, "off1": 0.4}
    assert [effect["effect"] for effect in effects] == ["stribeck", "joint_coupling", "payload"]
    assert effects[0]["parameters"] == {"excess": 1.0, "speed": 0.2}
    assert effects[1]["other_joint"] == "joint_2"
    assert bag.read_bytes() != plain.read_bytes()


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        (None, "cannot read the diagnosis"),
        (b"{", "not JSON"),
        ({"format": "idim_iv_ros/identification/1"}, "format"),
        ({"causes": None}, "causes"),
        ([STRIBECK, STRIBECK | {"effect": "warp"}], "causes.1 warp"),
        ([STRIBECK | {"joint": "elbow"}], "causes.0 elbow"),
        ([STRIBECK | {"parameters": {"excess": "much"}}], "causes.0.parameters.excess.value"),
        ([STRIBECK | {"parameters": {"excess": 1.0}}], "causes.0 speed missing"),
        ({"parameters": {"Fv1": float("inf")}}, "extended_parameters.Fv1.value finite"),
    ],
)
def test_bad_diagnosis_is_one_line_with_file_and_key(run, tmp_path: Path, changes, words) -> None:
    gap, bag = tmp_path / "gap.json", tmp_path / "a.mcap"
    if isinstance(changes, bytes):
        gap.write_bytes(changes)
    elif changes is not None:
        gap_file(gap, **changes) if isinstance(changes, dict) else gap_file(gap, *changes)
    outcome = run("simulate", "--config", CONFIG / "arm2.yaml", "--out", bag, "--effects", gap)
    refused(outcome, 2, "gap.json", *words.split())
    assert not bag.exists()


def test_effects_that_were_written_by_hand_are_simulated(run, tmp_path: Path) -> None:
    """Base parameters and effects by name, with plain numbers."""
    file = tmp_path / "soft.json"
    shaft = {"effect": "elasticity", "joint": "joint_1", "parameters": {"stiffness": 2.0e4}}
    content = {"base_parameters": {"Fv1": 9.0}, "effects": [shaft]}
    file.write_text(json.dumps({"format": "idim_iv_ros/effects/1", **content}))
    config, bag = CONFIG / "arm2.yaml", tmp_path / "soft.mcap"
    run("simulate", "--config", config, "--out", bag, "--effects", file, status=0)
    truth = json.loads((tmp_path / "soft.truth.json").read_text())
    assert truth["Fv1"] == 9.0
    assert truth["effects"][0]["effect"] == "elasticity"


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


def test_diagnosis_writes_its_segments(run, config, tmp_path: Path) -> None:
    out = tmp_path / "run"
    options = ("--for", "diagnosis", "--duration", 90, "--rate", 200, "--floor", -0.2)
    done = run("excite", "--config", config(), "--out", out, *options, status=0)
    assert "stribeck" in done.out
    segments = json.loads((tmp_path / "run.json").read_text())["segments"]
    motion = read_trajectory(tmp_path / "run.csv")
    assert segments[-1]["end"] <= motion.duration <= 90.0
    starts = [segment["start"] for segment in segments]
    assert starts == sorted(starts)
    assert any("presliding" in segment["effects"] for segment in segments)


def test_short_time_limit_and_torques_that_were_not_checked_are_said(run, tmp_path: Path) -> None:
    """Of a robot without inertials."""
    command = f"excite --config {CONFIG / 'ur10.yaml'} --out {tmp_path / 'run'} --time-limit 0.001"
    done = run(command, *QUICK, status=0)
    assert "time limit" in done.out and "Torques" in done.out
    document = json.loads((tmp_path / "run.json").read_text())
    assert document["ended_early"] is True
    assert document["limits"]["torque_checked"] is False


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (("--floor", 5), "floor 5 m cannot be kept"),
        (("--start", "0,9"), "start of joint joint_2, 9, lies outside"),
        (("--start", "0,x"), "numbers separated by commas"),
        (("--start", "0"), "1 values for 2 joints"),
        (("--time-limit", -1), "time limit -1"),
        (("--for", "diagnosis", "--duration", 5), "duration 5"),
        (("--duration", 60), "--duration"),
        (("--for", "servo", "--period", 5), "--period"),
        (("--for", "servo", "--start", "0,0"), "--start"),
    ],
)
def test_bad_request_is_one_line_and_leaves_nothing(run, config, tmp_path, arguments, complaint):
    folder = tmp_path / "new"
    folder.mkdir()
    done = run("excite", "--config", config(), "--out", folder / "run", *arguments, status=2)
    assert complaint in done.error
    assert len(done.error.strip().splitlines()) == 1
    assert not list(folder.iterdir())
