"""Tables of any content end in a bag or in one line that says which rows of which file."""

import json
from pathlib import Path

import h5py
import numpy as np
import pyarrow as pa
import pytest
from pyarrow import parquet

from idim_iv_ros.errors import DataError, UsageError
from idim_iv_ros.recording import ImportSummary, import_table, read_recordings
from idim_iv_ros.recording.lerobot import import_lerobot
from idim_iv_ros.recording.table_file import parquet_columns

JOINTS = ["a", "b"]
TIME = np.arange(1000) / 100.0
GOOD = np.column_stack([np.sin(TIME), np.cos(TIME)])


def convert(folder: Path, position: str, effort: str | None = None, **keywords) -> ImportSummary:
    np.save(folder / "effort.npy", 1.0 + GOOD)
    keywords.setdefault("rate", 100.0)
    return import_table(
        folder / "out.mcap",
        joints=JOINTS,
        position=position,
        effort=effort or str(folder / "effort.npy"),
        **keywords,
    )


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1.1e6, -1e100])
def test_a_few_impossible_rows_become_missing_and_are_named(tmp_path: Path, value) -> None:
    table = GOOD.copy()
    table[[300, 700, 701], 1] = value
    np.save(tmp_path / "q.npy", table)
    summary = convert(tmp_path, str(tmp_path / "q.npy"))
    (warning,) = summary.warnings
    for words in ("q.npy: position", "3 of 1000 rows", "the first 300 and the last 701", "for b"):
        assert words in warning
    (recording,) = read_recordings([tmp_path / "out.mcap"], joints=JOINTS)
    np.testing.assert_allclose(recording.position.values, GOOD, atol=1e-3)
    kept = np.setdiff1d(np.arange(1000), [300, 700, 701])
    np.testing.assert_allclose(recording.position.values[kept], GOOD[kept], atol=1e-12)


@pytest.mark.parametrize("value", [np.nan, np.inf, 1.1e6, 1e300])
@pytest.mark.parametrize("signal", ["position", "effort", "reference", "velocity"])
def test_many_impossible_rows_are_refused_with_first_last_and_count(tmp_path, value, signal):
    table = GOOD.copy()
    table[100:150, 0] = value if signal != "effort" or value != 1.1e6 else 1e10
    np.save(tmp_path / "bad.npy", table)
    np.save(tmp_path / "good.npy", GOOD)
    sources = {"position": str(tmp_path / "good.npy"), signal: str(tmp_path / "bad.npy")}
    with pytest.raises(DataError) as caught:
        convert(tmp_path, **sources)
    kind = "position" if signal == "reference" else signal
    for words in (f"bad.npy: {kind}", "50 of 1000 rows", "first 100 and the last 149", "for a"):
        assert words in str(caught.value)
    assert not (tmp_path / "out.mcap").exists()


@pytest.mark.parametrize("rate", [1e-300, 1e-7, 1e10, 1e300, 0.0, -5.0, np.nan, np.inf])
def test_a_rate_that_no_stamp_can_hold_is_refused(tmp_path: Path, rate: float) -> None:
    np.save(tmp_path / "q.npy", GOOD)
    with pytest.raises(UsageError, match="--rate"):
        convert(tmp_path, str(tmp_path / "q.npy"), rate=rate)


@pytest.mark.parametrize("stamps", [TIME - 1.0, TIME * 1e9, TIME * 1e-12, TIME + 3e9])
def test_stamps_that_ros_cannot_hold_are_refused(tmp_path: Path, stamps) -> None:
    np.save(tmp_path / "q.npy", GOOD)
    np.save(tmp_path / "t.npy", stamps)
    with pytest.raises(DataError, match=r"t\.npy: stamps"):
        convert(tmp_path, str(tmp_path / "q.npy"), rate=None, time=str(tmp_path / "t.npy"))


def test_a_name_that_is_too_long_is_no_file(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="File name too long"):
        convert(tmp_path, str(tmp_path / ("q" * 300 + ".npy")))


@pytest.mark.parametrize("key", ["q1,q2", "1,2", "q1,2"])
@pytest.mark.parametrize("comments", ["", "# "])
def test_columns_are_named_by_the_header_or_by_numbers_from_0(tmp_path, key, comments) -> None:
    table = tmp_path / "t.csv"
    rows = np.column_stack([TIME, GOOD])
    np.savetxt(table, rows, delimiter=",", header="t,q1,q2", comments=comments, fmt="%.17g")
    convert(tmp_path, f"{table}:{key}", rate=None, time=f"{table}:0")
    (recording,) = read_recordings([tmp_path / "out.mcap"], joints=JOINTS)
    np.testing.assert_allclose(recording.position.values, GOOD, atol=1e-9)
    with pytest.raises(UsageError, match=r"column 3; .* t, q1, q2, "):
        convert(tmp_path, f"{table}:3,1")


def test_a_variable_of_hdf5_needs_no_map(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "t.h5", "w") as file:
        file["run/q"] = GOOD.T
    convert(tmp_path, f"{tmp_path / 't.h5'}:run/q")
    (recording,) = read_recordings([tmp_path / "out.mcap"], joints=JOINTS)
    np.testing.assert_allclose(recording.position.values, GOOD, atol=1e-9)


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
