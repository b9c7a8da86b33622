"""Rows that are no message, values that no robot has, bags of other kinds and by other names."""

import os
import sqlite3
from pathlib import Path

import numpy as np
import pytest
from mcap.writer import Writer
from rosbags.rosbag2 import StoragePlugin

from idim_iv_ros.errors import DataError, IdimError
from idim_iv_ros.recording import Recording, read_recordings
from idim_iv_ros.recording.bags.folder import Bag
from tests.recording.bag_writer import STORE, float_array, joint_state, steady, write


def read(path: Path) -> Recording:
    return read_recordings([path], joints=["a", "b"])[0]


def change(path: Path, table: str, statement: str) -> None:
    """Change a table after taking its constraints away."""
    with sqlite3.connect(path) as connection:
        connection.execute(f"CREATE TABLE copied AS SELECT * FROM {table}")
        connection.execute(f"DROP TABLE {table}")
        connection.execute(f"ALTER TABLE copied RENAME TO {table}")
        connection.execute(statement)
    connection.close()


@pytest.mark.parametrize("value", ["NULL", "'text'", "17", "1.5", "zeroblob(3)"])
@pytest.mark.parametrize("column", ["data", "timestamp"])
def test_rows_that_are_no_message_are_left_out(tmp_path: Path, column: str, value: str) -> None:
    folder = write(tmp_path / "bag", steady(300), StoragePlugin.SQLITE3)
    (path,) = folder.glob("*.db3")
    change(path, "messages", f"UPDATE messages SET {column} = {value} WHERE id % 50 = 7")
    before = path.read_bytes()
    recording = read(folder)
    assert path.read_bytes() == before
    assert recording.samples == 300
    accepted = (column, value) == ("timestamp", "17")
    assert accepted or any(note.limits for note in recording.notes)
    time_ = recording.start + np.arange(300) / recording.rate
    np.testing.assert_allclose(recording.position.values[:, 0], time_, atol=1e-6)


@pytest.mark.parametrize("field", ["position", "effort"])
@pytest.mark.parametrize("value", [1e100, -1e100, np.inf, 2e9])
def test_one_impossible_value_is_left_out_with_message_joint_and_value(tmp_path, field, value):
    messages = steady(300)
    values = {"position": [2.0, 12.0], "effort": [3.0, 4.0]}
    values[field][1] = value
    messages[100] = ("/joint_states", 7.0, joint_state(2.0, **values))
    recording = read(write(tmp_path / "bag", messages))
    (note,) = [note for note in recording.notes if note.limits]
    assert f"{field}: message 101 holds {value:.3g} for b" in note.what
    assert "left out" in note.what
    np.testing.assert_allclose(recording.position.values[100], [2.0, 12.0], atol=1e-6)
    np.testing.assert_allclose(recording.effort.values[100], [3.0, 4.0], atol=1e-6)


@pytest.mark.parametrize("scale", [1e10, 1e300])
def test_efforts_of_another_world_are_refused(tmp_path: Path, scale: float) -> None:
    messages = steady(100)
    messages += [("/effort", 1.0 + k / 50, float_array([scale, 1.0])) for k in range(100)]
    bag = write(tmp_path / "bag", messages)
    with pytest.raises(DataError, match=r"100 of 100 .* 1 .* 100 "):
        read_recordings([bag], joints=["a", "b"], effort="/effort")


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


@pytest.mark.parametrize("value", ["NULL", "'text'", "17"])
@pytest.mark.parametrize("column", ["name", "type", "serialization_format", "id"])
def test_topics_without_names_end_in_one_line(tmp_path: Path, column: str, value: str) -> None:
    folder = write(tmp_path / "bag", steady(300), StoragePlugin.SQLITE3)
    (path,) = folder.glob("*.db3")
    change(path, "topics", f"UPDATE topics SET {column} = {value}")
    with pytest.raises(IdimError) as caught:
        read(folder)
    assert "\n" not in str(caught.value)


def test_a_pipe_is_refused_and_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.mcap")
    with pytest.raises(DataError, match="a pipe"):
        read_recordings(tmp_path / "pipe.mcap", joints="a")
    with pytest.raises(DataError, match=r"no \.mcap"):
        read_recordings(tmp_path, joints="a")
