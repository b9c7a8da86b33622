"""Episodes of LeRobot data sets, written here by pyarrow as versions 2 and 3 lay them out."""

import json
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from pyarrow import parquet

from idim_iv_ros.errors import DataError, UsageError
from idim_iv_ros.recording import read_recordings
from idim_iv_ros.recording.lerobot import import_lerobot
from idim_iv_ros.recording.table_file import parquet_columns

NAMES = ["pan.pos", "lift.pos", "gripper.pos"]
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


@pytest.fixture(params=[2, 3])
def data_set(request, tmp_path: Path) -> Path:
    folder = tmp_path / "set"
    chunk = folder / "data" / "chunk-000"
    chunk.mkdir(parents=True)
    (folder / "meta").mkdir()
    feature = {"dtype": "float32", "shape": [3], "names": NAMES}
    features = {"observation.state": feature, "action": feature}
    content = {"fps": RATE, "total_episodes": 2, "features": features}
    (folder / "meta" / "info.json").write_text(json.dumps(content))
    if request.param == 2:
        for episode in (0, 1):
            parquet.write_table(table(episode), chunk / f"episode_{episode:06d}.parquet")
    else:
        whole = pa.concat_tables([table(0), table(1)])
        parquet.write_table(whole, chunk / "file-000.parquet")
    return folder


def test_episode_becomes_a_bag_in_rad(data_set, tmp_path):
    scale = np.pi / 180.0
    summary = import_lerobot(
        tmp_path / "run.mcap", data_set, episode=1, joints=["j1=pan.pos", "lift.pos"], scale=scale
    )
    assert (summary.samples, summary.rate) == (FRAMES, pytest.approx(RATE))
    assert "no measured times" in summary.warnings[0]
    (recording,) = read_recordings(
        tmp_path / "run.mcap", joints=["j1", "lift.pos"], effort="none", reference="joint_reference"
    )
    np.testing.assert_allclose(recording.position.values, scale * states(1)[:, :2], atol=1e-9)
    command = recording.position_reference.values
    np.testing.assert_allclose(command, scale * (states(1)[:, :2] + 1.0), atol=1e-9)


@pytest.mark.parametrize(
    ("options", "error", "words"),
    [
        ({}, DataError, r"pan.pos is at .*--scale 0.0174533"),
        ({"joints": ["elbow"]}, UsageError, r"no column elbow.*pan.pos, lift.pos, gripper.pos"),
        ({"episode": 7}, UsageError, "episode 7"),
    ],
    ids=["degrees", "column", "episode"],
)
def test_what_is_not_there_or_no_angle_is_refused(data_set, tmp_path, options, error, words):
    with pytest.raises(error, match=words):
        import_lerobot(tmp_path / "run.mcap", data_set, **options)
    assert not (tmp_path / "run.mcap").exists()


def test_dates_of_a_parquet_file_are_stamps(tmp_path):
    seconds = 1.7e9 + 0.01 * np.arange(5)
    stamps = pa.array(np.round(1e6 * seconds).astype("datetime64[us]"))
    parquet.write_table(pa.table({"t": stamps}), tmp_path / "d.parquet")
    np.testing.assert_allclose(
        parquet_columns([tmp_path / "d.parquet"], "t")[:, 0], seconds, rtol=0.0, atol=1e-6
    )
