"""Bags by other names and of other kinds: ROS 1, capitals, pipes, two types on a topic."""

import os
from pathlib import Path

import numpy as np
import pytest
from mcap.writer import Writer
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.typesys import Stores, get_typestore

from idim_iv_ros.errors import DataError, UsageError
from idim_iv_ros.recording import read_recordings
from idim_iv_ros.recording.bags.folder import Bag
from tests.recording.bag_writer import STORE, float_array, joint_state, steady, write

_ROS1 = get_typestore(Stores.ROS1_NOETIC)
_STATE = "sensor_msgs/msg/JointState"
_OWN = "my_msgs/msg/Axes"
_OWN_TEXT = "Header header\nstring[] joint_names\nfloat64[] values"


def _stamp(seconds: float) -> object:
    return _ROS1.types["builtin_interfaces/msg/Time"](
        sec=int(seconds), nanosec=round(seconds % 1.0 * 1e9)
    )


def ros1_bag(path: Path, compression: str | None = None, count: int = 200) -> Path:
    """JointStates as those of `steady`, and a type of somebody's own beside them."""
    from rosbags.typesys import get_types_from_msg

    store = get_typestore(Stores.ROS1_NOETIC)
    store.register(get_types_from_msg(_OWN_TEXT, _OWN))
    header = store.types["std_msgs/msg/Header"]
    writer = Ros1Writer(path)
    if compression:
        writer.set_compression(Ros1Writer.CompressionFormat[compression])
    with writer:
        states = writer.add_connection("/joint_states", _STATE, typestore=store)
        axis_values = writer.add_connection("/axes", _OWN, typestore=store)
        for number in range(count):
            seconds = 1.0 + number / 100.0
            first = header(seq=number, stamp=_stamp(seconds), frame_id="base")
            modern = joint_state(seconds)
            state = store.types[_STATE](
                header=first, name=modern.name, position=modern.position,
                velocity=modern.velocity, effort=modern.effort,
            )  # fmt: skip
            axes = store.types[_OWN](
                header=first, joint_names=["a", "b"], values=2.0 * modern.position
            )
            time = round((5.0 + seconds) * 1e9)
            writer.write(states, time, store.serialize_ros1(state, _STATE))
            writer.write(axis_values, time, store.serialize_ros1(axes, _OWN))
    return path


@pytest.mark.parametrize("compression", [None, "LZ4", "BZ2"])
def test_a_bag_of_ros_1_is_read_as_the_same_one_of_ros_2(tmp_path: Path, compression) -> None:
    old = ros1_bag(tmp_path / "run.bag", compression)
    new = write(tmp_path / "run", steady())
    (one,) = read_recordings(old, joints=("a", "b"))
    (other,) = read_recordings(new, joints=("a", "b"))
    assert one.rate == other.rate and one.start == other.start
    np.testing.assert_array_equal(one.position.values, other.position.values)
    np.testing.assert_array_equal(one.effort.values, other.effort.values)


def test_a_field_of_a_type_of_ros_1_that_only_the_bag_defines_is_read(tmp_path: Path) -> None:
    bag = ros1_bag(tmp_path / "run.bag")
    (recording,) = read_recordings(bag, joints=("a", "b"), reference="/axes#values")
    assert recording.position_reference is not None
    expected = 2.0 * recording.position.values
    np.testing.assert_allclose(recording.position_reference.values, expected, rtol=0, atol=1e-9)


@pytest.mark.parametrize("size", [0, 300, 20_000])
def test_a_torn_bag_of_ros_1_is_one_line(tmp_path: Path, size: int) -> None:
    whole = ros1_bag(tmp_path / "run.bag").read_bytes()
    torn = tmp_path / "torn.bag"
    torn.write_bytes(whole[:size])
    with pytest.raises(DataError, match="rosbag reindex") as caught:
        read_recordings(torn, joints=("a", "b"))
    assert "\n" not in str(caught.value)


def test_a_damaged_chunk_of_ros_1_is_said(tmp_path: Path) -> None:
    content = bytearray(ros1_bag(tmp_path / "run.bag", "BZ2").read_bytes())
    content[len(content) // 3] ^= 0x55
    torn = tmp_path / "torn.bag"
    torn.write_bytes(content)
    with pytest.raises(DataError, match="the file is damaged"):
        read_recordings(torn, joints=("a", "b"))


def test_suffixes_in_capitals_are_those_of_bags(tmp_path: Path) -> None:
    (file,) = write(tmp_path / "run", steady()).glob("*.mcap")
    (tmp_path / "folder").mkdir()
    for path in (tmp_path / "RUN.MCAP", tmp_path / "folder" / "RUN.Mcap"):
        path.write_bytes(file.read_bytes())
    (alone,) = read_recordings(tmp_path / "RUN.MCAP", joints="a")
    (within,) = read_recordings(tmp_path / "folder", joints="a")
    assert np.array_equal(alone.position.values, within.position.values)


def test_a_pipe_is_refused_and_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.mcap")
    with pytest.raises(DataError, match="a pipe"):
        read_recordings(tmp_path / "pipe.mcap", joints="a")
    with pytest.raises(DataError, match=r"no \.mcap"):
        read_recordings(tmp_path, joints="a")


@pytest.mark.parametrize("swapped", [False, True])
def test_two_types_on_one_topic_are_named(tmp_path: Path, swapped: bool) -> None:
    kinds = [_STATE, "std_msgs/msg/Float64MultiArray"]
    path = tmp_path / "two.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start("ros2", "")
        for kind in reversed(kinds) if swapped else kinds:
            text, _ = STORE.generate_msgdef(kind, ros_version=2)
            schema = writer.register_schema(kind, "ros2msg", text.encode())
            channel = writer.register_channel("/joint_states", "cdr", schema)
            for number in range(50):
                time = 10**9 + 10**7 * number
                message = joint_state(time / 1e9) if kind == _STATE else float_array([1.0, 2.0])
                writer.add_message(channel, time, bytes(STORE.serialize_cdr(message, kind)), time)
        writer.finish()
    assert all(kind in Bag(path).topic_types()["/joint_states"] for kind in kinds)
    with pytest.raises(DataError, match="several types") as caught:
        read_recordings(path, joints=("a", "b"))
    assert all(kind in str(caught.value) for kind in kinds)


def test_a_field_that_a_joint_state_has_is_not_denied(tmp_path: Path) -> None:
    bag = write(tmp_path / "run", steady())
    with pytest.raises(UsageError, match="leave #velocity out") as caught:
        read_recordings(bag, joints="a", joint_states="/joint_states#velocity")
    assert "no field" not in str(caught.value)
