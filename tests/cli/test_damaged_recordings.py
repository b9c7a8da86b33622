"""What a user is told of clocks that jump, wraps, impossible values and damaged files."""

import json
from pathlib import Path

import numpy as np
import pytest

from tests.cli.conftest import JOINTS, write_arm

SKIPPED = slice(None, None, 5)  # every fifth sample of a 1 kHz record


@pytest.fixture
def arm(record, tmp_path: Path):
    """Write the two-joint arm's record with changes."""

    def write(change=lambda values: values) -> Path:
        names = ("time", "position", "position_reference")
        values = {name: getattr(record, name).copy() for name in names}
        change({name: signal[SKIPPED] for name, signal in values.items()})  # views
        return write_arm(tmp_path / "arm.mcap", record, SKIPPED, **values)

    return write


def test_a_wrapped_recording_is_checked_as_the_continuous_one_and_the_wraps_are_said(
    run, config, arm
) -> None:
    plain = run("check", arm(), "--config", config())

    def wrap(values) -> None:
        for name in ("position", "position_reference"):
            joint = values[name][:, 0]
            middle = 0.5 * (values["position"][:, 0].max() + values["position"][:, 0].min())
            values[name][:, 0] = (joint - middle) % (2.0 * np.pi) - np.pi

    wrapped = run("check", arm(wrap), "--config", config())
    assert plain.status == wrapped.status == 0, wrapped.error
    assert "joint_1 wraps" in wrapped.out

    def motion(out: str) -> list[str]:
        return [line.strip() for line in out.splitlines() if "moves over" in line]

    assert motion(plain.out)
    assert motion(wrapped.out) == motion(plain.out)


def test_a_clock_that_jumps_is_named_by_check_as_a_limit(run, config, arm) -> None:
    def jump(values) -> None:
        values["time"][300:] += 1e9

    outcome = run("check", arm(jump), "--config", config(), status=0)
    (line,) = [line for line in outcome.out.splitlines() if "/joint_states: at message 301" in line]
    assert "limited" in line
    assert "set" in line or "jumps forward" in line


def test_one_impossible_row_is_said_by_identify_and_changes_little(
    run, config, arm, tmp_path: Path
) -> None:
    def spoil(values) -> None:
        values["position"][777, 1] = 1e100

    bag = arm(spoil)
    outcome = run("identify", bag, "--config", config(), "--out", tmp_path / "out", status=0)
    assert {"778", "1e+100", "joint_2,"} <= set(outcome.out.split())
    assert "message 778" in (tmp_path / "out" / "report.html").read_text()


@pytest.mark.parametrize(
    ("jump", "words"),
    [(5e4, "joint_2 0.3 5e+04"), (0.3, "no joint moves: the most is")],
)
def test_rest_is_named_with_its_numbers_or_the_jump_of_a_sensor(
    run, config, arm, jump: float, words: str
) -> None:
    def still(values) -> None:
        random = np.random.default_rng(0)
        values["position"][:] = random.normal(0.3, 1e-6, values["position"].shape)
        values["position"][1000, 1] = jump
        values["position_reference"][:] = 0.3

    outcome = run("check", arm(still), "--config", config(), status=1)
    assert set(words.split()) <= set(outcome.error.split())


def test_a_jump_of_one_sensor_is_not_called_rest(run, config, arm, tmp_path: Path) -> None:
    def spoil(values) -> None:
        values["position"][1000, 1] = 5e4

    outcome = run("identify", arm(spoil), "--config", config(), "--out", tmp_path / "out", status=1)
    said = " ".join(outcome.error.split())
    assert "joint_2" in said and "arm.mcap" in said
    assert "5e+04" in said


@pytest.mark.parametrize(
    ("rows", "status", "words"),
    [
        (slice(10, 12), 0, "2 of 200 rows, the first 10 and the last 11"),
        (slice(10, 60), 1, "50 of 200 rows, the first 10 and the last 59"),
    ],
)
@pytest.mark.parametrize("value", ["nan", "inf", "2e6", "1e300"])
def test_import_names_impossible_rows(
    run, tmp_path: Path, rows: slice, status: int, words: str, value: str
) -> None:
    table = np.column_stack([np.sin(np.arange(200) / 10.0 + k) for k in range(4)])
    table[rows, 1] = float(value)
    np.savetxt(tmp_path / "t.csv", table, delimiter=",")
    out = tmp_path / "out.mcap"
    columns = (f"{tmp_path / 't.csv'}:0,1", f"{tmp_path / 't.csv'}:2,3")
    outcome = run(
        *("import", out, "--rate", 100, "--position", columns[0], "--effort", columns[1]),
        *("--joints", ",".join(JOINTS)),
    )
    assert outcome.status == status, outcome.error
    said = " ".join(outcome.error.split())
    assert words in said
    assert "t.csv:0,1: position" in said
    assert out.exists() == (status == 0)


@pytest.mark.parametrize("rate", ["1e-300", "nan", "inf", "0", "-5", "1e300"])
def test_import_refuses_a_rate_that_is_none(run, tmp_path: Path, rate: str) -> None:
    np.savetxt(tmp_path / "t.csv", np.ones((50, 2)), delimiter=",")
    table = tmp_path / "t.csv"
    outcome = run(
        *("import", tmp_path / "out.mcap", f"--rate={rate}", "--joints", "a,b"),
        *("--position", table, "--effort", table),
    )
    assert outcome.status == 2
    assert "--rate" in outcome.error
    assert len(outcome.error.strip().splitlines()) == 1
    assert not (tmp_path / "out.mcap").exists()


def test_help_says_that_columns_are_counted_from_0(run) -> None:
    assert "counted from 0" in " ".join(run("import", "--help").out.replace("│", " ").split())


def test_a_name_that_is_too_long_is_one_line(run, config, tmp_path: Path) -> None:
    outcome = run("check", tmp_path / ("b" * 300 + ".mcap"), "--config", config(), status=2)
    assert "too long" in outcome.error
    assert len(outcome.error.strip().splitlines()) == 1


def test_a_torn_bag_without_any_message_is_not_called_empty(run, config, arm) -> None:
    path = arm()
    path.write_bytes(path.read_bytes()[:100])
    outcome = run("check", path, "--config", config(), status=1)
    assert "0 messages on /joint_states" in outcome.error
    assert "empty" not in outcome.error


def test_a_second_that_is_lost_costs_little_accuracy(run, config, record, tmp_path: Path) -> None:
    """The relative error is that of the whole recording: no corner at a gap widens the filters."""
    errors = []
    for lost in (slice(0, 0), slice(1200, 1700)):
        rows = np.delete(np.arange(0, len(record.time), 2), lost)
        bag = write_arm(tmp_path / "arm.mcap", record, rows)
        out = tmp_path / f"out{lost.stop}"
        assert run("identify", bag, "--config", config(), "--out", out).status == 0
        document = json.loads((out / "result.json").read_text())
        errors.append(document["fit"]["relative_error_percent"])
    assert errors[1] < 1.5 * errors[0]
