"""Tables of any content end in a bag or in one line that says which rows of which file."""

import json
from pathlib import Path

import numpy as np
import pytest

from idim_iv_ros.errors import DataError, UsageError
from idim_iv_ros.recording.read import read_recordings
from idim_iv_ros.recording.table import ImportSummary, import_table

JOINTS = ["a", "b"]
TIME = np.arange(1000) / 100.0
GOOD = np.column_stack([np.sin(TIME), np.cos(TIME)])


def convert(folder: Path, time: str = "rate: 100.0", **signals: np.ndarray) -> ImportSummary:
    """Import arrays as a file of them, by a map with `time` in it."""
    signals = {"position": GOOD, "effort": 1.0 + GOOD} | signals
    np.savez(folder / "t.npz", **signals)
    kinds = [signal for signal in signals if signal != "t"]
    described = {joint: {kind: f"{kind}[{k}]" for kind in kinds} for k, joint in enumerate(JOINTS)}
    joints = json.dumps(described)  # YAML reads it
    (folder / "map.yaml").write_text(f"file: t.npz\n{time}\njoints: {joints}\n")
    return import_table(folder / "out.mcap", folder / "map.yaml", force=True)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1.1e6, -1e100])
def test_a_few_impossible_rows_become_missing_and_are_named(tmp_path: Path, value) -> None:
    table = GOOD.copy()
    table[[300, 700, 701], 1] = value
    (warning,) = convert(tmp_path, position=table).warnings
    for words in ("t.npz: position", "3 of 1000 rows", "the first 300 and the last 701", "for b"):
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
    with pytest.raises(DataError) as caught:
        convert(tmp_path, **{signal: table})
    kind = "position" if signal == "reference" else signal
    for words in (f"t.npz: {kind}", "50 of 1000 rows", "first 100 and the last 149", "for a"):
        assert words in str(caught.value)
    assert not (tmp_path / "out.mcap").exists()


@pytest.mark.parametrize("rate", [1e-300, 1e-7, 1e10, 1e300, 0.0, -5.0, np.nan, np.inf])
def test_a_rate_that_no_stamp_can_hold_is_refused(tmp_path: Path, rate: float) -> None:
    with pytest.raises((UsageError, DataError), match=r"map\.yaml: rate|t\.npz: stamps"):
        convert(tmp_path, f"rate: {rate!r}".replace("inf", ".inf").replace("nan", ".nan"))


@pytest.mark.parametrize("stamps", [TIME - 1.0, TIME * 1e9, TIME * 1e-12, TIME + 3e9])
def test_stamps_that_ros_cannot_hold_are_refused(tmp_path: Path, stamps) -> None:
    with pytest.raises(DataError, match=r"t\.npz: stamps"):
        convert(tmp_path, "time: {column: t}", t=stamps)


@pytest.mark.parametrize("columns", [("q1", "q2"), ("1", "2"), ("q1", "2")])
@pytest.mark.parametrize("comments", ["", "# "])
def test_columns_are_named_by_the_header_or_by_numbers_from_0(tmp_path, columns, comments) -> None:
    rows = np.column_stack([TIME, GOOD])
    header = {"delimiter": ",", "header": "t,q1,q2", "comments": comments, "fmt": "%.17g"}
    np.savetxt(tmp_path / "t.csv", rows, **header)
    text = "file: t.csv\ntime: {column: '0'}\njoints: {a: {position: '%s'}, b: {position: '%s'}}\n"
    (tmp_path / "map.yaml").write_text(text % columns)
    import_table(tmp_path / "out.mcap", tmp_path / "map.yaml")
    (recording,) = read_recordings([tmp_path / "out.mcap"], joints=JOINTS, effort="none")
    np.testing.assert_allclose(recording.position.values, GOOD, atol=1e-9)
    (tmp_path / "map.yaml").write_text(text % ("3", "1"))
    with pytest.raises(UsageError, match=r"column 3; .* t, q1, q2, "):
        import_table(tmp_path / "out.mcap", tmp_path / "map.yaml", force=True)
