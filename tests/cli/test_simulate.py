"""The command that writes the recording of a simulated robot."""

import json
from pathlib import Path

import pytest

from tests.cli.conftest import refused
from tests.inputs import gap_content

CONFIG = Path(__file__).resolve().parents[2] / "config"


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
    outcome = run(command, status=0)
    assert "1991 samples" in outcome.out


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
        (b"\xff\xfe\x00", "not a text file"),
        (b"[]", "format"),
        ({"format": "idim_iv_ros/identification/1"}, "format"),
        ({"causes": None}, "causes"),
        ({"causes": ["stribeck"]}, "causes.0"),
        ([STRIBECK, STRIBECK | {"effect": "warp"}], "causes.1 warp"),
        ([STRIBECK | {"joint": "elbow"}], "causes.0 elbow"),
        ([STRIBECK | {"joint": 2}], "causes.0.joint"),
        (
            [STRIBECK | {"parameters": {"excess": "much", "speed": 0.1}}],
            "causes.0.parameters.excess.value",
        ),
        ([STRIBECK | {"parameters": {"excess": 1.0}}], "causes.0 speed missing"),
        ({"parameters": {"ZZ9": 1.0}}, "extended_parameters.ZZ9"),
        ({"extended_parameters": None}, "extended_parameters"),
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
