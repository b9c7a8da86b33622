"""Rows of databases that are no message, and values that no robot has."""

import sqlite3
from pathlib import Path

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin

from idim_iv_ros.errors import DataError
from idim_iv_ros.recording import Recording, read_recordings
from tests.recording.bag_writer import float_array, joint_state, steady, write


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
