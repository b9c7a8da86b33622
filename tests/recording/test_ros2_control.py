"""Controllers' states are read without their messages being installed: what, by which field."""

import sqlite3
from pathlib import Path

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin

from idim_iv_ros import DataError, UsageError, read_recordings
from tests.recording.control_messages import ARM, LBR, MANY, ControlBag

JOINTS = ["a", "b"]
STATE = "/arm_controller/controller_state"
STAMPS = 1.0 + np.arange(200) / 100.0


def asked(stamp: float) -> np.ndarray:
    return np.array([np.sin(stamp), 2.0 + np.cos(stamp)])


def asked_speed(stamp: float) -> np.ndarray:
    return np.array([np.cos(stamp), -np.sin(stamp)])


def measured(stamp: float) -> np.ndarray:
    return asked(stamp - 0.05)


def torque(stamp: float) -> np.ndarray:
    return np.array([5.0 + stamp, 7.0 - stamp])


def on_states(bag: ControlBag, stamps=STAMPS) -> ControlBag:
    for stamp in stamps:
        bag.joint_state(stamp, JOINTS, measured(stamp), effort=torque(stamp))
    return bag


def on_controller(bag: ControlBag, stamps=STAMPS, names=("reference", "feedback"), order=(0, 1)):
    joints, order = [JOINTS[k] for k in order], list(order)
    for stamp in stamps:
        points = {
            names[0]: bag.point(stamp, asked(stamp)[order], asked_speed(stamp)[order]),
            names[1]: bag.point(stamp, measured(stamp)[order]),
        }
        bag.state(stamp, joints, **points)
    return bag


def read(bag: Path, **topics):
    (recording,) = read_recordings([bag], joints=JOINTS, **topics)
    return recording


def column(function) -> np.ndarray:
    return np.array([function(stamp) for stamp in STAMPS])


@pytest.mark.parametrize(
    ("version", "names"),
    [
        ("jazzy", ("reference", "feedback")),
        ("iron", ("reference", "feedback")),
        ("humble", ("reference", "feedback")),
        ("humble", ("desired", "actual")),  # on ~/state
        ("foxy", ("desired", "actual")),
    ],
)
@pytest.mark.parametrize("storage", [StoragePlugin.MCAP, StoragePlugin.SQLITE3])
def test_a_reference_is_what_the_controller_was_asked_for(tmp_path, version, names, storage):
    bag = on_controller(on_states(ControlBag(version)), names=names).write(
        tmp_path / "bag", storage
    )
    recording = read(bag, reference=STATE)
    assert np.array_equal(recording.position.values, column(measured))
    assert np.array_equal(recording.position_reference.values, column(asked))
    assert np.array_equal(recording.velocity_reference.values, column(asked_speed))
    assert recording.position_reference.origin == f"{STATE} {names[0]}.positions"


@pytest.mark.parametrize("version", ["jazzy", "iron", "humble", "foxy"])
def test_a_database_without_definitions_is_read_by_the_versions_that_are_known(tmp_path, version):
    names = ("desired", "actual") if version == "foxy" else ("reference", "feedback")
    bag = on_controller(on_states(ControlBag(version)), names=names)
    folder = bag.write(tmp_path / "bag", StoragePlugin.SQLITE3)
    (database,) = folder.glob("*.db3")
    with sqlite3.connect(database) as connection:  # as Humble leaves it
        connection.execute("DROP TABLE message_definitions")
    recording = read(folder, reference=STATE)
    assert np.array_equal(recording.position_reference.values, column(asked))


def test_one_topic_gives_what_was_asked_for_and_what_was_measured(tmp_path: Path) -> None:
    bag = ControlBag()
    for stamp in STAMPS:
        bag.state(
            stamp,
            JOINTS,
            reference=bag.point(stamp, asked(stamp)),
            feedback=bag.point(stamp, measured(stamp), asked_speed(stamp)),
            output=bag.point(stamp, effort=torque(stamp)),
        )
    recording = read(bag.write(tmp_path / "bag"), joint_states=STATE, reference=STATE)
    assert np.array_equal(recording.position.values, column(measured))
    assert np.array_equal(recording.velocity.values, column(asked_speed))
    assert np.array_equal(recording.effort.values, column(torque))
    assert np.array_equal(recording.position_reference.values, column(asked))
    assert recording.effort.origin == f"{STATE} output.effort"


@pytest.mark.parametrize("field", ["feedback", "actual"])
def test_a_named_field_is_read_under_its_old_name_too(tmp_path: Path, field) -> None:
    bag = on_controller(on_states(ControlBag())).write(tmp_path / "bag")
    recording = read(bag, reference=f"{STATE}#{field}")
    assert np.array_equal(recording.position_reference.values, column(measured))


def test_joints_are_found_by_name_whatever_their_order_and_number(tmp_path: Path) -> None:
    bag = on_controller(on_states(ControlBag()), order=(1, 0)).write(tmp_path / "bag")
    recording = read(bag, reference=STATE)
    assert np.array_equal(recording.position_reference.values, column(asked))
    # Every message has another time from the start, and all are one layout.
    assert not any("layouts" in note.what for note in recording.notes)
    (only,) = read_recordings([bag], joints=["b"], reference=STATE)
    assert np.array_equal(only.position_reference.values, column(asked)[:, 1:])


def test_what_comes_before_and_after_the_controller_is_active_is_left_out(tmp_path: Path) -> None:
    bag = on_states(ControlBag())
    for stamp in STAMPS[:50]:
        bag.state(stamp, JOINTS)
    for stamp in STAMPS[50:60]:
        bag.state(stamp, JOINTS, reference=bag.point(stamp, [np.nan, np.nan]))
    on_controller(bag, STAMPS[60:180])
    recording = read(bag.write(tmp_path / "bag"), reference=STATE)
    assert not recording.position_reference.invented.any()
    assert np.array_equal(recording.position.values, column(measured)[60:180])
    # By a spline between the same stamps.
    assert recording.position_reference.values == pytest.approx(column(asked)[60:180], abs=1e-12)
    assert any("first 0.6 s and the last 0.2 s" in n.what for n in recording.notes)


def test_a_controller_that_was_never_active_is_refused(tmp_path: Path) -> None:
    bag = on_states(ControlBag())
    for stamp in STAMPS:
        bag.state(stamp, JOINTS)
    with pytest.raises(DataError, match=r"empty or NaN"):
        read(bag.write(tmp_path / "bag"), reference=STATE)


INTERFACES = [["effort", "position", "velocity", "motor_current"], ["position", "effort"]]


def dynamic(bag: ControlBag) -> ControlBag:
    for stamp in STAMPS:
        (first, second), (one, two) = measured(stamp), torque(stamp)
        rows = [[one, first, asked_speed(stamp)[0], 30.0 * one], [second, two], [25.0]]
        bag.dynamic(stamp, [*JOINTS, "tool_sensor"], [*INTERFACES, ["temperature"]], rows)
    return bag


def test_dynamic_joint_states_are_read_by_the_names_of_interfaces(tmp_path: Path) -> None:
    recording = read(
        dynamic(ControlBag()).write(tmp_path / "bag"), joint_states="/dynamic_joint_states"
    )
    assert np.array_equal(recording.position.values, column(measured))
    assert np.array_equal(recording.effort.values, column(torque))
    assert recording.velocity is None  # b has none


def test_an_interface_of_another_name_is_the_effort(tmp_path: Path) -> None:
    bag = dynamic(ControlBag()).write(tmp_path / "bag")
    (recording,) = read_recordings(
        [bag],
        joints=["a"],
        joint_states="/dynamic_joint_states",
        effort="/dynamic_joint_states#motor_current",
    )
    assert np.array_equal(recording.effort.values, 30.0 * column(torque)[:, :1])


def test_single_degrees_of_freedom_are_read_by_name(tmp_path: Path) -> None:
    bag = on_states(ControlBag())
    kind = bag.store.types["control_msgs/msg/SingleDOFState"]
    for stamp in STAMPS:
        states = [
            kind(name, float(asked(stamp)[k]), float(measured(stamp)[k]), 0.0, 0.0, 0.0, 0.01, 1.0)
            for k, name in enumerate(JOINTS)
        ]
        message = bag.store.types[MANY](bag.header(stamp), states)
        bag.add("/pid_controller/controller_state", stamp, message)
    recording = read(bag.write(tmp_path / "bag"), reference="/pid_controller/controller_state")
    assert np.array_equal(recording.position_reference.values, column(asked))


def lbr(bag: ControlBag) -> ControlBag:
    for k, stamp in enumerate(STAMPS):
        message = bag.store.types[LBR](4, 0.01, asked(stamp), torque(stamp), k)
        bag.add("/lbr/state", stamp, message)
    return bag


def test_a_field_of_any_message_is_read_in_the_order_of_the_joints(tmp_path: Path) -> None:
    bag = lbr(on_states(ControlBag())).write(tmp_path / "bag", late=0.0)
    recording = read(
        bag, reference="/lbr/state#commanded_joint_position", effort="/lbr/state#measured_torque"
    )
    # Without a header the time is that of arrival.
    assert recording.position_reference.values == pytest.approx(column(asked), abs=1e-12)
    assert np.array_equal(recording.effort.values, column(torque))


def test_a_joint_state_within_a_message_is_read_by_name(tmp_path: Path) -> None:
    bag = on_states(ControlBag())
    for stamp in STAMPS:
        inner = bag.joint_state(stamp, ["b", "a"], asked(stamp)[::-1], topic="")
        bag.add("/arm/state", stamp, bag.store.types[ARM](bag.header(stamp), "idle", inner))
    recording = read(bag.write(tmp_path / "bag"), reference="/arm/state#desired_joint_state")
    assert np.array_equal(recording.position_reference.values, column(asked))


@pytest.mark.parametrize(
    ("source", "sentence"),
    [
        ("/lbr/state", r"say which of its fields .* as /lbr/state#FIELD \(session_state, "),
        ("/lbr/state#wrong", "has no numbers in wrong; its fields are session_state, "),
        (f"{STATE}#wrong", "#wrong is none of reference, feedback, error, output"),
        ("/joint_states#wrong", "sensor_msgs/msg/JointState: leave #wrong out"),
    ],
)
def test_a_field_that_is_not_there_is_refused_with_those_that_are(tmp_path, source, sentence):
    bag = lbr(on_controller(on_states(ControlBag()))).write(tmp_path / "bag")
    with pytest.raises((DataError, UsageError), match=sentence):
        read(bag, reference=source)


def test_a_field_of_a_relative_topic_is_found_in_the_namespace_of_the_robot(tmp_path) -> None:
    bag = ControlBag()
    for stamp in STAMPS:
        bag.joint_state(stamp, JOINTS, measured(stamp), (), torque(stamp), "/left/joint_states")
        points = {"feedback": bag.point(stamp, asked(stamp))}
        bag.state(stamp, JOINTS, "/left/arm/controller_state", **points)
    recording = read(
        bag.write(tmp_path / "bag"),
        joint_states="joint_states",
        reference="arm/controller_state#feedback",
    )
    assert np.array_equal(recording.position_reference.values, column(asked))


def test_a_bag_with_an_unused_controller_state_says_so(tmp_path: Path) -> None:
    bag = on_controller(on_states(ControlBag())).write(tmp_path / "bag")
    assert read(bag).unused_references == (STATE,)
    with pytest.raises(DataError, match=f"write `reference: {STATE}` under signals"):
        read(bag, reference="/joint_reference")


def test_bytes_that_are_no_message_of_the_type_are_left_out(tmp_path: Path) -> None:
    bag = on_controller(on_states(ControlBag()))
    folder = bag.write(tmp_path / "bag", StoragePlugin.SQLITE3)
    (database,) = folder.glob("*.db3")
    random = np.random.default_rng(0)
    with sqlite3.connect(database) as connection:
        rows = connection.execute(
            "SELECT messages.id, data FROM messages JOIN topics ON topic_id = topics.id "
            "WHERE name = ? ORDER BY messages.id LIMIT 100 OFFSET 20",
            (STATE,),
        ).fetchall()
        for number, data in rows[::10]:
            cut = bytes(data[: int(random.integers(4, len(data) - 16))])
            connection.execute("UPDATE messages SET data = ? WHERE id = ?", (cut, number))
    recording = read(folder, reference=STATE)
    assert any(note.what.startswith("damaged") and note.count == 10 for note in recording.notes)
    assert np.abs(recording.position_reference.values - column(asked)).max() < 1e-6
