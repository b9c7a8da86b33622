"""Tables as loggers write them become the same bag by a map, and what is wrong has one line."""

from pathlib import Path

import h5py
import numpy as np
import pyarrow
import pytest
from pyarrow import parquet
from scipy.io import savemat

from idim_iv_ros.errors import DataError, UsageError
from idim_iv_ros.recording import import_table, read_recordings
from idim_iv_ros.recording.table_map import proposed_map

TIME = np.arange(1500) * 0.002
POSITION = np.column_stack([np.sin(TIME), np.cos(2.0 * TIME)])
EFFORT = np.column_stack([3.0 * np.cos(TIME), np.sin(TIME)])
JOINTS = ["a", "b"]


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
        start = np.datetime64("2026-03-01T08:00:00.000")
        stamps = [str(start + np.timedelta64(2 * k, "ms")) for k in range(len(TIME))]
        if comma:
            stamps = [stamp.replace(".", ",") for stamp in stamps]
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
    start = np.datetime64("2026-03-01T08:00:00.000")
    stamps = [str(start + np.timedelta64(2 * k, "ms")) for k in range(len(TIME))]
    if comma:
        stamps = [f"{2 * k}" for k in range(len(TIME))]
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
    assert "\n" not in str(caught.value)
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
