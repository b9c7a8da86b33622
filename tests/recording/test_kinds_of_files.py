"""Bags by other names and of other kinds: ROS 1, capitals, pipes, two types on a topic."""

import os
from pathlib import Path

import numpy as np
import pytest
from mcap.writer import Writer

from idim_iv_ros.errors import DataError
from idim_iv_ros.recording import read_recordings
from idim_iv_ros.recording.bags.folder import Bag
from tests.recording.bag_writer import STORE, float_array, joint_state, steady, write

_STATE = "sensor_msgs/msg/JointState"


def test_a_bag_of_ros_1_is_refused_with_what_converts_it(tmp_path: Path) -> None:
    (tmp_path / "run.bag").write_bytes(b"#ROSBAG V2.0\n")
    with pytest.raises(DataError, match=r"rosbags-convert --src .*run\.bag --dst run`") as caught:
        read_recordings(tmp_path / "run.bag", joints="a")
    assert "\n" not in str(caught.value)


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
