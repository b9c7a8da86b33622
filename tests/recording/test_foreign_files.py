"""Files of other programs, and tables that become bags by a map."""

import os
import sqlite3
from pathlib import Path

import h5py
import numpy as np
import pyarrow
import pytest
from mcap.writer import Writer
from pyarrow import parquet
from rosbags.rosbag2 import StoragePlugin
from scipy.io import savemat

from idim_iv_ros.errors import DataError, IdimError, UsageError
from idim_iv_ros.recording.bags.folder import Bag
from idim_iv_ros.recording.bags.joint_message_type import JOINT_STATE
from idim_iv_ros.recording.read import read_recordings
from idim_iv_ros.recording.recording import Recording
from idim_iv_ros.recording.table import import_table, proposed_map
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


def test_a_bag_of_ros_1_is_refused_with_what_converts_it(tmp_path: Path) -> None:
    (tmp_path / "run.bag").write_bytes(b"#ROSBAG V2.0\n")
    with pytest.raises(DataError, match=r"rosbags-convert --src .*run\.bag --dst run`"):
        read_recordings(tmp_path / "run.bag", joints="a")


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
    kinds = {
        JOINT_STATE: joint_state,
        "std_msgs/msg/Float64MultiArray": lambda _: float_array([1.0, 2.0]),
    }
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
                data = bytes(STORE.serialize_cdr(kinds[kind](time / 1e9), kind))
                writer.add_message(channel, time, data, time)
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
    with pytest.raises(IdimError):
        read(folder)


def test_a_pipe_is_refused_and_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.mcap")
    with pytest.raises(DataError, match="a pipe"):
        read_recordings(tmp_path / "pipe.mcap", joints="a")
    with pytest.raises(DataError, match=r"no \.mcap"):
        read_recordings(tmp_path, joints="a")


TIME = np.arange(1500) * 0.002
POSITION = np.column_stack([np.sin(TIME), np.cos(2.0 * TIME)])
EFFORT = np.column_stack([3.0 * np.cos(TIME), np.sin(TIME)])
JOINTS = ["a", "b"]
DATES = [str(np.datetime64("2026-03-01T08:00:00.000") + 2 * k) for k in range(len(TIME))]


def _imported(folder: Path, text: str) -> tuple[np.ndarray, np.ndarray, tuple[str, ...]]:
    """Positions and efforts of the bag that a map makes, and warnings."""
    (folder / "map.yaml").write_text(text)
    summary = import_table(folder / "out.mcap", folder / "map.yaml", force=True)
    (recording,) = read_recordings([folder / "out.mcap"], joints=JOINTS)
    assert summary.rate == pytest.approx(500.0)
    return recording.position.values, recording.effort.values, summary.warnings


def _text(stamps: list[str], comma: bool, gap: int | None = None) -> str:
    """A log with a comment, quoted names with spaces, degrees, and an empty cell."""
    lines = ["# by a logger of its own", '"Stamp";"Pos A";"Pos B";"Tau A";"Tau B";"Mode"']
    for k, stamp in enumerate(stamps):
        cells = [f"{value:.9f}" for value in (*np.degrees(POSITION[k]), *EFFORT[k])]
        if k == gap:
            cells[1] = ""
        row = ";".join([stamp, *cells, "run"])
        lines.append(row.replace(".", ",") if comma else row)
    return "\n".join(lines) + "\n"


TEXT_MAP = """
file: log.csv
time: {{column: Stamp, unit: {unit}}}
decimal: '{decimal}'
units: {{position: deg}}
joints:
  a: {{position: Pos A, effort: Tau A}}
  b: {{position: Pos B, effort: Tau B}}
"""


@pytest.mark.parametrize("comma", [False, True])
@pytest.mark.parametrize("unit", ["s", "ms", "iso"])
def test_a_messy_text_is_the_same_recording(tmp_path: Path, comma: bool, unit: str) -> None:
    if unit == "iso":
        stamps = [date.replace(".", ",") if comma else date for date in DATES]
    else:
        stamps = [f"{time * (1e3 if unit == 'ms' else 1.0):.4f}" for time in TIME]
    (tmp_path / "log.csv").write_text(_text(stamps, comma, gap=77), encoding="utf-8-sig")
    described = TEXT_MAP.format(unit=unit, decimal="," if comma else ".")
    if unit == "iso" and comma:
        with pytest.raises(DataError, match="no time of ISO 8601"):
            _imported(tmp_path, described)
        return
    position, effort, warnings = _imported(tmp_path, described)
    np.testing.assert_allclose(position, POSITION, atol=1e-5)
    np.testing.assert_allclose(effort, EFFORT, atol=1e-7)
    assert "row 77 holds nan for b" in warnings[0]


@pytest.mark.parametrize("comma", [False, True])
def test_a_proposed_map_has_the_signs_and_units_of_the_text(tmp_path: Path, comma: bool) -> None:
    stamps = [f"{2 * k}" for k in range(len(TIME))] if comma else DATES
    text = _text(stamps, comma).replace("Pos A", "Pos A [°]").replace("Stamp", "Stamp (ms)")
    (tmp_path / "log.csv").write_text(text.replace("Tau B", "Tau B [mNm]"))
    proposed = proposed_map(tmp_path / "log.csv")
    assert f"unit: {'ms' if comma else 'iso'}}}" in proposed
    assert "position: deg" in proposed
    position, effort, _ = _imported(tmp_path, proposed)
    np.testing.assert_allclose(position, POSITION, atol=1e-5)
    np.testing.assert_allclose(effort, 1e-3 * EFFORT, atol=1e-7)


def test_a_single_row_is_refused(tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_text(_text(["0.0"], comma=False))
    with pytest.raises(DataError, match="1 samples"):
        _imported(tmp_path, TEXT_MAP.format(unit="s", decimal="."))
    assert not (tmp_path / "out.mcap").exists()


@pytest.mark.parametrize("suffix", ["h5", "npz", "mat", "parquet"])
def test_arrays_are_named_by_their_datasets(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"log.{suffix}"
    arrays = {"time": TIME, "q": POSITION, "tau": EFFORT}
    if suffix == "h5":
        with h5py.File(path, "w") as file:
            for name, values in arrays.items():
                file.create_dataset(f"run/{name}", data=values)
    elif suffix == "npz":
        np.savez(path, **arrays)
    elif suffix == "mat":
        savemat(path, arrays)
    else:
        columns = {"time": TIME, "q0": POSITION[:, 0], "q1": POSITION[:, 1]}
        columns |= {"tau0": EFFORT[:, 0], "tau1": EFFORT[:, 1]}
        parquet.write_table(pyarrow.table(columns), path)
    group = "run/" if suffix == "h5" else ""
    column = "{}{}" if suffix == "parquet" else group + "{}[{}]"
    joints = "\n".join(
        f"  {name}: {{position: '{column.format('q', k)}', effort: '{column.format('tau', k)}'}}"
        for k, name in enumerate(JOINTS)
    )
    position, effort, _ = _imported(
        tmp_path, f"file: {path.name}\ntime: {{column: {group}time}}\njoints:\n{joints}\n"
    )
    np.testing.assert_allclose(position, POSITION, atol=1e-9)
    np.testing.assert_allclose(effort, EFFORT, atol=1e-9)
    text = proposed_map(path)
    for k in range(2):
        assert f"joint_{k}: {{position: '{column.format('q', k)}'" in text
    assert f"time: {{column: '{group}time', unit: s}}" in text


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        (("Tau A", "Tau C"), "no column Tau C; there are Stamp, Pos A"),
        (("effort: Tau A", "velocity: Tau A"), "velocity of b is missing"),
        (("Tau A", "Mode"), "Mode holds 'run': no number"),
        (("log.csv", "other.csv"), "no such file"),
        (("unit: s", "unit: h"), "unit"),
        (("joints:", "rate: 100.0\njoints:"), "give either time or rate"),
    ],
)
def test_what_is_wrong_has_one_line(tmp_path: Path, changed: tuple[str, str], words: str) -> None:
    (tmp_path / "log.csv").write_text(_text([f"{time:.4f}" for time in TIME], comma=False))
    text = TEXT_MAP.format(unit="s", decimal=".")
    with pytest.raises((UsageError, DataError)) as caught:
        _imported(tmp_path, text.replace(*changed))
    assert words in str(caught.value)
    assert not (tmp_path / "out.mcap").exists()


@pytest.mark.parametrize(
    ("text", "proposed"),
    [
        ("time,pos_1,tau_1\n0.0,1.0,2.0\n9,9\n", "position: 'pos_1'"),
        ("time,pos_1,tau_1\n0.0,1.0,2.0\n0,0,0,0\n", "position: 'pos_1'"),
        # Letters in brackets are joints where they are no unit.
        ("t,Pos [A],Pos [B],Tau [A],Tau [B]\n" + "0,1,2,3,4\n" * 3, "a: {position: 'Pos [A]'"),
        ("", None),
        ("# a comment\n", None),
    ],
)
def test_a_map_is_proposed_for_any_text_with_a_row(tmp_path: Path, text: str, proposed) -> None:
    (tmp_path / "log.csv").write_text(text)
    if proposed is None:
        with pytest.raises(UsageError, match="no row"):
            proposed_map(tmp_path / "log.csv")
    else:
        assert proposed in proposed_map(tmp_path / "log.csv")
