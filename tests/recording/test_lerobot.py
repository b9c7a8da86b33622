"""Episodes of LeRobot data sets, written here by pyarrow as versions 2 and 3 lay them out."""

from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from pyarrow import parquet

from idim_iv_ros.errors import DataError
from idim_iv_ros.recording.read import read_recordings
from idim_iv_ros.recording.table import ImportSummary, import_table, proposed_map
from idim_iv_ros.recording.table_file import read_array

JOINTS = ["pan", "lift", "gripper"]
FRAMES, RATE = 90, 30.0


def states(episode: int) -> np.ndarray:
    time = np.arange(FRAMES)[:, None] / RATE
    return 20.0 * np.sin(2.0 * time * np.array([1.0, 0.7, 0.4]) + episode)  # degrees


def table(episode: int) -> pa.Table:
    state = states(episode)
    return pa.table(
        {
            "observation.state": state.tolist(),
            "action": (state + 1.0).tolist(),
            "timestamp": np.arange(FRAMES) / RATE,
            "frame_index": np.arange(FRAMES),
            "episode_index": np.full(FRAMES, episode),
        }
    )


def imported(tmp_path: Path, rows: str = "") -> ImportSummary:
    joints = "".join(
        f"  {name}: {{position: 'observation.state[{k}]', reference: 'action[{k}]'}}\n"
        for k, name in enumerate(JOINTS)
    )
    (tmp_path / "map.yaml").write_text(
        f"file: d.parquet\n{rows}rate: {RATE}\nunits: {{position: deg}}\njoints:\n{joints}"
    )
    return import_table(tmp_path / "run.mcap", tmp_path / "map.yaml")


@pytest.mark.parametrize("version", [2, 3])
def test_episode_becomes_a_bag_in_rad(tmp_path: Path, version: int) -> None:
    """Version 2 has a file for each episode, version 3 several episodes in one."""
    whole = table(1) if version == 2 else pa.concat_tables([table(0), table(1)])
    parquet.write_table(whole, tmp_path / "d.parquet")
    summary = imported(tmp_path, "" if version == 2 else "rows: {episode_index: 1}\n")
    assert (summary.samples, summary.rate) == (FRAMES, pytest.approx(RATE))
    (recording,) = read_recordings(
        tmp_path / "run.mcap", joints=JOINTS, effort="none", reference="joint_reference"
    )
    np.testing.assert_allclose(recording.position.values, np.radians(states(1)), atol=1e-9)
    command = recording.position_reference.values
    np.testing.assert_allclose(command, np.radians(states(1) + 1.0), atol=1e-9)


def test_an_episode_that_is_not_there_is_refused(tmp_path: Path) -> None:
    parquet.write_table(table(0), tmp_path / "d.parquet")
    with pytest.raises(DataError, match="0 samples"):
        imported(tmp_path, "rows: {episode_index: 7}\n")
    assert not (tmp_path / "run.mcap").exists()


def test_a_map_of_an_episode_is_proposed(tmp_path: Path) -> None:
    parquet.write_table(table(0), tmp_path / "d.parquet")
    text = proposed_map(tmp_path / "d.parquet")
    assert "joint_1: {position: 'observation.state[1]', reference: 'action[1]'}" in text
    assert "column: 'timestamp'" in text


def test_dates_of_a_parquet_file_are_stamps(tmp_path: Path) -> None:
    seconds = 1.7e9 + 0.01 * np.arange(5)
    stamps = pa.array(np.round(1e6 * seconds).astype("datetime64[us]"))
    parquet.write_table(pa.table({"t": stamps}), tmp_path / "d.parquet")
    read = read_array(tmp_path / "d.parquet", "t")[:, 0]
    np.testing.assert_allclose(read, seconds, rtol=0.0, atol=1e-6)
