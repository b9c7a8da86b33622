"""A bag of ros2_control as it is: no JointState with the reference, but a controller's state."""

import json
from pathlib import Path

import pytest

from bags import simulated_arms
from idim_iv_ros import load_configuration
from idim_iv_ros.configuration import Configuration
from idim_iv_ros.errors import UsageError
from idim_iv_ros.first_configuration.drivers import driver_files, read_driver
from tests.recording.control_messages import ControlBag

ARM = simulated_arms.CONFIG / "arm2.urdf"
DRIVERS = ["franka", "kinova", "kuka_fri", "ros2_control", "ur"]
SCALED = "/scaled_joint_trajectory_controller/controller_state"


@pytest.fixture(scope="module")
def bag(record, tmp_path_factory) -> Path:
    """The arm as a UR's driver would publish it, at 500 Hz; at first no controller is active."""
    made = ControlBag()
    joints = ["joint_2", "joint_1"]
    for k in range(0, 6000, 2):
        stamp = record.time[k]
        made.joint_state(
            stamp, joints, record.position[k, ::-1], effort=0.1 * record.effort[k, ::-1]
        )
        asked = record.position_reference[k], record.velocity_reference[k]
        points = {
            "reference": made.point(stamp, *asked),
            "feedback": made.point(stamp, record.position[k]),
        }
        made.state(stamp, joints[::-1], SCALED, **(points if stamp > 0.5 else {}))
    return made.write(tmp_path_factory.mktemp("ur") / "bag")


def test_the_state_of_a_controller_is_a_reference_with_valid_instruments(run, bag, tmp_path):
    out = tmp_path / "arm.yaml"
    run("init", bag, "--urdf", ARM, "--out", out, status=0)
    configuration = load_configuration(out)
    assert configuration.signals.reference == SCALED
    assert "what the controller was asked for" in out.read_text()
    assert configuration.controller.type == "pd"
    checked = json.loads(run("check", bag, "--config", out, "--json").out)
    sentences = [finding["sentence"] for finding in checked["findings"]]
    assert any(
        f"the reference is reference.positions of {SCALED}" in sentence for sentence in sentences
    )

    identified = json.loads(run("identify", bag, "--config", out, "--json").out)
    assert identified["instruments"]["accepted"] is True


def test_a_driver_gives_topics_and_unit_with_its_name_as_the_reason(run, bag, tmp_path) -> None:
    out = tmp_path / "arm.yaml"
    done = run("init", bag, "--urdf", ARM, "--driver", "ur", "--out", out, status=0)
    signals = load_configuration(out).signals
    assert (signals.joint_states, signals.reference) == ("/joint_states", SCALED)
    assert signals.effort_unit == "A"
    assert "driver ur" in done.out


def test_topics_of_a_driver_that_are_not_there_are_said_and_others_are_found(run, bag, tmp_path):
    out = tmp_path / "arm.yaml"
    done = run("init", bag, "--urdf", ARM, "--driver", "kinova", "--out", out, status=0)
    assert load_configuration(out).signals.reference == SCALED
    assert (
        "/joint_trajectory_controller/controller_state of the driver kinova is not in the bag"
        in out.read_text()
    )
    # The efforts are a tenth of what the masses need.
    assert "Warning: efforts of the driver kinova are in N m, but" in done.out


@pytest.mark.parametrize("name", DRIVERS)
def test_drivers_hold_what_a_configuration_may_hold(name: str) -> None:
    preset = read_driver(name)
    whole = {"robot": {"joints": ["a", "b", "c"]}, **preset.keys}
    signals = Configuration.model_validate(whole).signals
    assert signals.reference is not None
    assert "effort_unit" in preset.keys["signals"]
    text = preset.path.read_text()
    assert "https://" in text  # the documentation that it follows


def test_a_driver_of_the_user_is_a_file_of_the_same_form(run, bag, tmp_path: Path) -> None:
    driver, out = tmp_path / "own.yaml", tmp_path / "arm.yaml"
    driver.write_text(
        f"signals:\n  reference: {{topic: {SCALED}, field: feedback}}\n  effort_unit: A\n"
        "identification:\n  drive_inertia: false\n"
    )
    assert run("init", bag, "--urdf", ARM, "--driver", driver, "--out", out).status == 0
    configuration = load_configuration(out)
    assert configuration.signals.reference == f"{SCALED}#feedback"
    assert configuration.identification.drive_inertia is False


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("robot: {joints: [a]}\n", "leave the key robot out"),
        ("signals: {reference: {topic: /a, fields: b}}\n", "signals.reference: a topic, or topic"),
        ("signals: {reference: '/a#'}\n", "signals.reference: '/a#' is no topic with a field"),
        ("signals: {reference: 3}\n", "signals.reference: a text"),
        ("colour: red\n", "unknown key colour"),
    ],
)
def test_a_wrong_driver_is_refused_in_one_line(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "own.yaml"
    path.write_text(text)
    with pytest.raises(UsageError, match=words) as caught:
        read_driver(str(path))
    assert str(path) in str(caught.value)


def test_an_unknown_driver_is_answered_with_the_others() -> None:
    assert sorted(driver_files()) == DRIVERS
    with pytest.raises(UsageError, match=r"abb: .*franka, kinova, kuka_fri"):
        read_driver("abb")
