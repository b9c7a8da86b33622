"""A first configuration from a bag: what a stranger does before reading anything."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

from bags import simulated_arms
from idim_iv_ros import load_configuration, write_bag
from idim_iv_ros.configuration import Configuration
from idim_iv_ros.errors import UsageError
from idim_iv_ros.first_configuration.proposal import SECTIONS, driver_files, read_driver
from idim_iv_ros.recording.writing.write import JointTopic
from tests.cli.conftest import JOINTS, refused
from tests.recording.control_messages import ControlBag

ARM = (simulated_arms.CONFIG / "arm2.urdf").read_text()
GRIPPER = """
  <link name="finger_1"/><link name="finger_2"/><link name="rail_link"/><link name="lamp_link"/>
  <joint name="left_finger_joint" type="prismatic">
    <parent link="link_2"/><child link="finger_1"/><axis xyz="0 0 1"/>
    <limit lower="0" upper="0.04" velocity="0.1" effort="10"/></joint>
  <joint name="follower" type="revolute">
    <parent link="link_2"/><child link="finger_2"/><axis xyz="0 0 1"/>
    <limit lower="0" upper="1" velocity="1" effort="1"/><mimic joint="left_finger_joint"/></joint>
  <joint name="rail" type="prismatic">
    <parent link="link_2"/><child link="rail_link"/><axis xyz="0 0 1"/>
    <limit lower="0" upper="1" velocity="1" effort="1"/></joint>
  <joint name="lamp" type="fixed"><parent link="link_2"/><child link="lamp_link"/></joint>
</robot>"""


@pytest.fixture
def urdf(tmp_path: Path) -> Path:
    """The arm with a gripper, a follower, a rail that nobody records, and a lamp."""
    path = tmp_path / "models" / "arm.urdf"
    path.parent.mkdir()
    path.write_text(ARM.replace("</robot>", GRIPPER))
    return path


def states(record, *, scale: float = 1.0, extra: tuple[str, ...] = ()) -> JointTopic:
    """Joint states in another order than the URDF's, with joints that stand still."""
    count = len(record.time)
    return JointTopic(
        "/joint_states",
        ["joint_2", "joint_1", *extra],
        record.time,
        np.column_stack([record.position[:, ::-1], np.full((count, len(extra)), 0.01)]),
        None,
        np.column_stack([scale * record.effort[:, ::-1], np.zeros((count, len(extra)))]),
    )


def reference(record) -> JointTopic:
    references = record.position_reference, record.velocity_reference
    return JointTopic("/arm/joint_command", JOINTS, record.time, *references)


@pytest.fixture
def init(run, tmp_path: Path):
    """Propose a configuration from topics; return its file, what was printed and the bag."""

    def call(*topics: JointTopic, status: int = 0, options=(), description: str | None = ARM):
        bag, out = tmp_path / "run.mcap", tmp_path / "arm.yaml"
        write_bag(bag, topics, robot_description=description)
        return out, run("init", bag, "--out", out, *options, status=status), bag

    return call


def test_stranger_goes_from_a_bag_to_parameters_by_the_commands_that_are_named(
    run, record, urdf, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Neither a configuration nor a word of documentation: every line names the next one."""
    monkeypatch.chdir(tmp_path)
    write_bag("run1.mcap", [states(record, extra=("left_finger_joint", "torso"))])
    assert "idim-iv init BAG… --urdf FILE" in run("identify", "run1.mcap", status=2).error
    refused(run("init", "run1.mcap"), 2, "run1.mcap", "--urdf")
    done = run("init", "run1.mcap", "--urdf", "models/arm.urdf")
    for command in ("init", "check", "identify"):
        assert done.status == 0, done.error
        if command == "identify":
            break
        following = re.search(r"^Next: idim-iv (.*)$", done.out, re.MULTILINE)
        assert following, done.out
        done = run(*following[1].split())
    assert "Verdict" in done.out
    document = json.loads((tmp_path / "results" / "result.json").read_text())
    assert document["joints"] == simulated_arms.arm2().configuration.robot.joints
    configuration = load_configuration("my_arm.yaml")
    assert configuration.controller.type == "unknown"
    assert configuration.signals.effort_unit == "N m"


def test_what_is_left_out_is_said_with_the_reason(run, record, urdf, tmp_path: Path) -> None:
    bag, out = tmp_path / "run.mcap", tmp_path / "sub" / "arm.yaml"
    out.parent.mkdir()
    write_bag(bag, [states(record, extra=("left_finger_joint", "torso"))])
    document = json.loads(run("init", bag, "--urdf", urdf, "--out", out, "--json").out)
    assert document["configuration"]["robot"] == {
        "urdf": "../models/arm.urdf",
        "joints": ["joint_1", "joint_2"],
    }
    reasons = {
        "left_finger_joint": "gripper",
        "follower": "made to follow left_finger_joint",
        "rail": "not in the bag",
        "torso": "not in the URDF",
    }
    assert document["left_out"].keys() == reasons.keys()
    text = out.read_text()
    for joint, reason in reasons.items():
        assert reason in document["left_out"][joint]
        assert f"# left out: {joint}: {document['left_out'][joint]}" in text
    assert load_configuration(out).robot.urdf == urdf.resolve()


def test_joint_that_stands_still_away_from_zero_is_warned_of(init, record) -> None:
    """The model locks it at zero, where it was not."""
    position = np.column_stack([record.position[:, 0], np.full(len(record.time), 0.7)])
    topic = JointTopic("/joint_states", JOINTS, record.time, position, None, record.effort)
    out, done, _ = init(topic, options=["--quiet"])
    assert "joint_2" in done.error and "0.7" in done.error
    assert load_configuration(out).robot.joints == ["joint_1"]


def test_control_law_and_reference_are_found_in_the_log(run, init, record) -> None:
    """The gains within 2 %, so that the instruments of the simulated loop are valid."""
    out, _, bag = init(states(record), reference(record))
    configuration, truth = load_configuration(out), simulated_arms.arm2().configuration
    assert configuration.robot.urdf is None
    assert configuration.signals.reference == "/arm/joint_command"
    assert configuration.controller.type == "pd"
    np.testing.assert_allclose(configuration.controller.kp, truth.controller.kp, rtol=0.02)
    np.testing.assert_allclose(configuration.controller.kd, truth.controller.kd, rtol=0.02)
    identified = run("identify", bag, "--config", out, "--json")
    assert json.loads(identified.out)["instruments"]["accepted"] is True


def test_efforts_that_are_no_torques_are_not_taken_for_torques(run, init, record, tmp_path) -> None:
    out, done, bag = init(states(record, scale=0.1), reference(record))
    assert load_configuration(out).signals.effort_unit == "A"
    assert "effort over the torque" in out.read_text()
    assert "effort_scale" in done.out
    assert run("identify", bag, "--config", out, "--out", tmp_path / "r").status == 0


@pytest.mark.parametrize(
    ("effort", "words"), [(0.0, ("effort", "zero throughout")), (np.nan, ("effort", "empty"))]
)
def test_bag_without_efforts_is_refused_in_one_line(init, record, effort, words) -> None:
    efforts = np.full_like(record.effort, effort)
    topic = JointTopic("/joint_states", JOINTS, record.time, record.position, None, efforts)
    out, done, _ = init(topic, status=1)
    refused(done, 1, "run.mcap", *words)
    assert not out.exists()


def test_edited_configuration_is_kept(run, init, record) -> None:
    out, _, bag = init(states(record))
    run("init", bag, "--out", out, status=0)
    out.write_text(out.read_text().replace("effort_unit: N m", "effort_unit: A"))
    refused(run("init", bag, "--out", out), 2, "arm.yaml", "--force")
    assert load_configuration(out).signals.effort_unit == "A"


def test_every_key_of_a_configuration_has_its_line(init, record) -> None:
    assert set(SECTIONS) == set(Configuration.model_fields) - {"source"}
    out, *_ = init(states(record))
    lines = out.read_text().splitlines()
    for section in SECTIONS.values():
        for name in section.model_fields:
            (*_, line) = [text for text in lines if re.match(rf"  (# )?{name}: ", text)]
            assert "default: " in line


def test_every_example_of_a_left_out_key_is_valid(init, record) -> None:
    """Each line may be taken as it is: the # away, and with it that of its section."""
    out, *_ = init(states(record))
    text = out.read_text()
    tried = 0
    for section, kind in SECTIONS.items():
        for name in kind.model_fields:
            # These are examples of other robots: a file, joints, a law.
            if name in ("urdf", "mjcf", "couplings", "kp", "kd", "ki", "kv", "drive_gain"):
                continue
            changed = re.sub(rf"^# ({section}:)$", r"\1", text, flags=re.MULTILINE)
            head, middle, tail = changed.partition(f"{section}:\n")
            tail, count = re.subn(rf"^  # ({name}: )", r"  \1", tail, count=1, flags=re.MULTILINE)
            if not count:
                continue
            out.write_text(head + middle + tail)
            load_configuration(out)
            tried += 1
    assert tried > 25


def test_unused_reference_is_answered_with_the_line_to_write(run, config, record, tmp_path) -> None:
    bag = tmp_path / "run.mcap"
    write_bag(bag, [states(record), reference(record)])
    line = "`reference: /arm/joint_command` under `signals:` in arm2.yaml"
    without = config(("reference: joint_reference", "effort_unit: N m"))
    checked = run("check", bag, "--config", without)
    assert line in " ".join(checked.out.split())
    done = run("identify", bag, "--config", without, "--out", tmp_path / "r")
    assert line in " ".join(done.out.split())
    assert line in json.dumps(json.loads((tmp_path / "r" / "result.json").read_text()))
    assert "reference: /arm/joint_command" in (tmp_path / "r" / "report.html").read_text()
    refused(run("check", bag, "--config", config()), 1, "`reference: /arm/joint_command`")
    right = config(("reference: joint_reference", "reference: /arm/joint_command"))
    assert "no reference" not in run("check", bag, "--config", right).out


DRIVEN = simulated_arms.CONFIG / "arm2.urdf"
DRIVERS = ["franka", "kinova", "kuka_fri", "ros2_control", "ur"]
SCALED = "/scaled_joint_trajectory_controller/controller_state"


@pytest.fixture(scope="module")
def bag(record, tmp_path_factory) -> Path:
    """The arm as a UR's driver would publish it, at 500 Hz; at first no controller is active."""
    made = ControlBag()
    joints = ["joint_2", "joint_1"]
    for k in range(0, 6000, 2):
        stamp = record.time[k]
        position, effort = record.position[k, ::-1], 0.1 * record.effort[k, ::-1]
        made.joint_state(stamp, joints, position, effort=effort)
        asked = record.position_reference[k], record.velocity_reference[k]
        points = {
            "reference": made.point(stamp, *asked),
            "feedback": made.point(stamp, record.position[k]),
        }
        made.state(stamp, joints[::-1], SCALED, **(points if stamp > 0.5 else {}))
    return made.write(tmp_path_factory.mktemp("ur") / "bag")


def test_the_state_of_a_controller_is_a_reference_with_valid_instruments(run, bag, tmp_path):
    out = tmp_path / "arm.yaml"
    run("init", bag, "--urdf", DRIVEN, "--out", out, status=0)
    configuration = load_configuration(out)
    assert configuration.signals.reference == SCALED
    assert "what the controller was asked for" in out.read_text()
    assert configuration.controller.type == "pd"
    checked = json.loads(run("check", bag, "--config", out, "--json").out)
    sentences = [finding["sentence"] for finding in checked["findings"]]
    assert any(f"reference.positions of {SCALED}" in sentence for sentence in sentences)
    identified = json.loads(run("identify", bag, "--config", out, "--json").out)
    assert identified["instruments"]["accepted"] is True


def test_a_driver_gives_topics_and_unit_with_its_name_as_the_reason(run, bag, tmp_path) -> None:
    out = tmp_path / "arm.yaml"
    done = run("init", bag, "--urdf", DRIVEN, "--driver", "ur", "--out", out, status=0)
    signals = load_configuration(out).signals
    assert (signals.joint_states, signals.reference) == ("/joint_states", SCALED)
    assert signals.effort_unit == "A"
    assert "driver ur" in done.out


def test_topics_of_a_driver_that_are_not_there_are_said_and_others_are_found(run, bag, tmp_path):
    out = tmp_path / "arm.yaml"
    done = run("init", bag, "--urdf", DRIVEN, "--driver", "kinova", "--out", out, status=0)
    assert load_configuration(out).signals.reference == SCALED
    assert "controller_state of the driver kinova is not in the bag" in out.read_text()
    # The efforts are a tenth of what the masses need.
    assert "Warning: efforts of the driver kinova are in N m, but" in done.out


@pytest.mark.parametrize("name", DRIVERS)
def test_drivers_hold_what_a_configuration_may_hold(name: str) -> None:
    preset = read_driver(name)
    whole = {"robot": {"joints": ["a", "b", "c"]}, **preset.keys}
    signals = Configuration.model_validate(whole).signals
    assert signals.reference is not None
    assert "effort_unit" in preset.keys["signals"]
    assert "https://" in driver_files()[name].read_text()  # the documentation that it follows


def test_a_driver_of_the_user_is_a_file_of_the_same_form(run, bag, tmp_path: Path) -> None:
    driver, out = tmp_path / "own.yaml", tmp_path / "arm.yaml"
    driver.write_text(
        f"signals:\n  reference: {{topic: {SCALED}, field: feedback}}\n  effort_unit: A\n"
        "identification:\n  drive_inertia: false\n"
    )
    assert run("init", bag, "--urdf", DRIVEN, "--driver", driver, "--out", out).status == 0
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
