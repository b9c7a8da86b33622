"""Relative names of a configuration, in bags of robots in namespaces."""

from pathlib import Path

import pytest
from rosbags.rosbag2 import StoragePlugin

from idim_iv_ros.errors import DataError
from idim_iv_ros.recording.read import read_recordings
from idim_iv_ros.recording.recording import Recording
from tests.recording.bag_writer import TYPES, joint_state, write

# By what they are shifted, which says from which topic values came.
SHIFTS = {"/left": 0.0, "/right": 100.0, "": 200.0}


def bag_of(folder: Path, *topics: str, storage: StoragePlugin = StoragePlugin.MCAP) -> Path:
    """A bag with these topics; positions are shifted by namespace, descriptions are the topic."""
    messages: list = []
    for topic in topics:
        if topic.endswith("robot_description"):
            messages.append((topic, 6.0, TYPES["std_msgs/msg/String"](data=topic)))
            continue
        shift = SHIFTS[topic.rpartition("/")[0]]
        for k in range(100):
            stamp = 1.0 + 0.01 * k
            position = [stamp + shift, stamp + shift + 10.0]
            messages.append((topic, 5.0 + stamp, joint_state(stamp, position=position)))
    return write(folder / "bag", messages, storage)


def read(bag: Path, **keywords: object) -> Recording:
    given = {"joint_states": "joint_states", "reference": "joint_reference", **keywords}
    (recording,) = read_recordings([bag], joints=["a", "b"], **given)
    return recording


def shifts(recording: Recording) -> tuple[float, float]:
    """Of measurements and references."""
    values = recording.position.values[0, 0], recording.position_reference.values[0, 0]
    return round(values[0] - 1.0), round(values[1] - 1.0)


LEFT = ("/left/joint_states", "/left/joint_reference", "/left/robot_description")
RIGHT = ("/right/joint_states", "/right/joint_reference", "/right/robot_description")
ROOT = ("/joint_states", "/joint_reference", "/robot_description")


@pytest.mark.parametrize("storage", [StoragePlugin.MCAP, StoragePlugin.SQLITE3])
@pytest.mark.parametrize("topics", [LEFT, RIGHT, ROOT])
def test_one_configuration_reads_a_robot_in_any_namespace(tmp_path, topics, storage) -> None:
    recording = read(bag_of(tmp_path, *topics, storage=storage))
    shift = SHIFTS[topics[0].rpartition("/")[0]]
    assert shifts(recording) == (shift, shift)
    assert recording.robot_description == topics[2]
    assert {clock.topic for clock in recording.clocks} == set(topics[:2])


def test_two_robots_in_one_bag_ask_which_is_meant(tmp_path: Path) -> None:
    bag = bag_of(tmp_path, *LEFT, *RIGHT)
    with pytest.raises(DataError) as refused:
        read(bag)
    for name in (str(bag), "signals.joint_states", "/left/joint_states", "/right/joint_states"):
        assert name in str(refused.value)
    whole = read(bag, joint_states="/right/joint_states", reference="/right/joint_reference")
    assert shifts(whole) == (100.0, 100.0)
    assert whole.robot_description == "/right/robot_description"


@pytest.mark.parametrize("remapped", ["/left", "/right"])
def test_who_asks_gets_the_robot_of_its_namespace_and_what_it_remaps(tmp_path, remapped) -> None:
    topics = {"joint_states": "/right/joint_states"}
    topics["joint_reference"] = f"{remapped}/joint_reference"
    bag = bag_of(tmp_path, *LEFT, *RIGHT, *ROOT)
    assert shifts(read(bag, resolved_topics=topics)) == (100.0, SHIFTS[remapped])
    assert shifts(read(bag)) == (200.0, 200.0)


def test_the_reference_of_another_robot_is_not_taken(tmp_path: Path) -> None:
    bag = bag_of(tmp_path, "/left/joint_states", "/right/joint_reference")
    with pytest.raises(DataError, match="no topic /left/joint_reference") as refused:
        read(bag)
    assert "/left/joint_states, /right/joint_reference" in str(refused.value)


@pytest.mark.parametrize("name", ["/joint_states", "states"])
def test_a_full_name_is_no_other_and_a_name_no_end_of_a_word(tmp_path: Path, name: str) -> None:
    with pytest.raises(DataError, match=rf"/{name.lstrip('/')}; .* /left/"):
        read(bag_of(tmp_path, *LEFT), joint_states=name)


@pytest.mark.parametrize(
    ("topics", "expected"),
    [
        ([*LEFT, "/robot_description"], "/left/robot_description"),
        ([*LEFT[:2], "/robot_description"], "/robot_description"),
        ([*LEFT[:2], "/right/robot_description"], None),
    ],
)
def test_description_is_that_of_the_namespace_else_the_global_one(tmp_path, topics, expected):
    assert read(bag_of(tmp_path, *topics)).robot_description == expected
