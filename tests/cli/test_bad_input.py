"""Bad input: one line with file and place, the right exit status, nothing half-written."""

import json
from pathlib import Path

import numpy as np
import pytest

from tests.cli.conftest import CONFIG, refused, said, write_arm
from tests.recording import bag_writer


@pytest.fixture
def identify(run, config, tmp_path: Path):
    """Identify a bag that must be refused, and look that nothing was left."""

    def call(bag: Path, status: int, *words: str, configuration: Path | None = None) -> None:
        out = tmp_path / "results"
        outcome = run("identify", bag, "--config", configuration or config(), "--out", out)
        refused(outcome, status, *words)
        assert not out.exists()

    return call


def test_joint_of_the_bag_that_the_urdf_does_not_have(identify, config, tmp_path: Path) -> None:
    bag = bag_writer.write(tmp_path / "bag", bag_writer.steady(3000, 1000.0))
    wrong = config(("[joint_1, joint_2]", "[a, b]"), ("joint_reference", "null"))
    identify(bag, 2, "arm2.urdf", "no joint a", "joint_1, joint_2", configuration=wrong)


def _without_motion(record) -> dict[str, np.ndarray]:
    random = np.random.default_rng(0)
    still = 0.3 + 1e-5 * random.normal(size=record.position.shape)
    effort = 5.0 + random.normal(size=record.effort.shape)
    return {"position": still, "effort": effort, "position_reference": still}


@pytest.mark.parametrize(
    ("changed", "rows", "words"),
    [
        (lambda _: {}, slice(5000, 5500), ("record",)),
        (_without_motion, slice(None), ("no joint moves",)),
        (
            lambda record: {"position": record.position * [1.0, 0.0] + [0.0, 0.4]},
            slice(None),
            ("joint_2 stands still", "Ia2, Fv2"),
        ),
    ],
    ids=["half a second", "no motion", "one joint at rest"],
)
def test_recording_that_says_too_little(identify, record, tmp_path, changed, rows, words) -> None:
    bag = write_arm(tmp_path / "r.mcap", record, rows, **changed(record))
    identify(bag, 1, "r.mcap", *words)


def test_rank_deficient_excitation_lists_what_cannot_be_seen(identify, config, record, tmp_path):
    """Both joints sweep at constant speed: friction and offset cannot be told apart."""
    position = np.outer(record.time, [0.2, 0.1])
    bag = write_arm(tmp_path / "sweep.mcap", record, position=position)
    wide = config(extra="processing:\n  position_cutoff: 50.0\n  decimation_cutoff: 20.0\n")
    words = ("sweep.mcap", "rank deficient", "Fc1", "record a richer motion")
    identify(bag, 1, *words, configuration=wide)


SINGULAR = ": [[0, 0], [0, 1]]\n  joints: [joint_1"


@pytest.mark.parametrize(
    ("old", "new", "status", "words"),
    [
        ("armature:", "armatur:", 2, "unknown key simulator.armatur"),
        ("kd: [52.0, 9.2]", "kd: [52.0]", 2, "controller.kd has 1 values"),
        ("robot:", "robot: [", 2, "line"),
        ("joints: [joint_1", f"motor_to_joint{SINGULAR}", 2, "motor_to_joint is singular"),
        ("joints: [joint_1", f"motor_to_joint_torque{SINGULAR}", 2, "_joint_torque is singular"),
        ("joint_states: joint_states", "joint_states: /states", 1, "/joint_states"),
        ("[joint_1, joint_2]", "[joint_1, elbow]", 1, "elbow"),
    ],
)
def test_wrong_configuration(identify, bag, config, old, new, status: int, words: str) -> None:
    file = "arm2.yaml" if status == 2 else "arm2.mcap"
    identify(bag, status, file, words, configuration=config((old, new)))


@pytest.mark.parametrize(
    ("processing", "words"),
    [
        ("{position_cutoff: 600.0}", ("position_cutoff", "500 Hz")),
        ("{position_cutoff: 10.0, decimation_cutoff: 20.0}", ("decimation_cutoff", "above")),
    ],
)
def test_contradictory_cutoffs(identify, bag, config, processing, words) -> None:
    identify(bag, 2, *words, configuration=config(extra=f"processing: {processing}\n"))


def test_gains_that_hardly_move_the_robot_end_in_an_answer(run, bag, config, tmp_path) -> None:
    weak = config(("kp: [1200.0, 250.0]", "kp: [1.0e-6, 1.0e-6]"))
    run("identify", bag, "--config", weak, "--out", tmp_path / "results", status=0)


def test_truncated_bag_is_read_as_far_as_it_goes_and_the_loss_is_said(run, config, bag, tmp_path):
    torn = tmp_path / "torn.mcap"
    content = bag.read_bytes()
    torn.write_bytes(content[: int(0.8 * len(content))])
    out = tmp_path / "results"
    run("identify", torn, "--config", config(), "--out", out, status=0)
    document = json.loads((out / "result.json").read_text())
    assert "ends in the middle" in json.dumps(document["bags"])
    assert "ends in the middle" in (out / "report.html").read_text()


@pytest.mark.parametrize("command", ["check BAG", "simulate --out OUT"])
def test_strange_link_is_warned_of(run, bag, config, tmp_path: Path, command: str) -> None:
    odd, arm = tmp_path / "odd.urdf", CONFIG / "arm2.urdf"
    odd.write_text(arm.read_text().replace('mass value="4.2"', 'mass value="0"', 1))
    words = command.replace("BAG", str(bag)).replace("OUT", str(tmp_path / "out.mcap")).split()
    outcome = run(*words, "--config", config((str(arm), str(odd))), status=0)
    assert "link link_1:" in outcome.out
    assert said(outcome.error) == []


def test_check_says_that_the_armature_was_not_given(run, bag, config) -> None:
    armature = "simulator:\n  armature: [0.25, 0.1]   # kg m², joint side\n"
    said = run("check", bag, "--config", config((armature, "")))
    assert "simulator.armature" in said.out
    assert "simulator.armature" not in run("check", bag, "--config", config()).out
