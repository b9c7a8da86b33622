"""What a user is told of clocks that jump, wraps, impossible values and damaged files."""

import json
from pathlib import Path

import numpy as np
import pytest

from tests.cli.conftest import write_arm

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


def test_one_impossible_row_is_said_by_identify_and_changes_little(run, config, arm, tmp_path):
    def spoil(values) -> None:
        values["position"][777, 1] = 1e100

    bag = arm(spoil)
    outcome = run("identify", bag, "--config", config(), "--out", tmp_path / "out", status=0)
    assert {"778", "1e+100", "joint_2,"} <= set(outcome.out.split())
    assert "message 778" in (tmp_path / "out" / "report.html").read_text()


@pytest.mark.parametrize("jump", [0.3, 5e4])
def test_rest_is_named_beside_a_jump_of_a_sensor_too(run, config, arm, jump):
    def still(values) -> None:
        random = np.random.default_rng(0)
        values["position"][:] = random.normal(0.3, 1e-6, values["position"].shape)
        values["position"][1000, 1] = jump
        values["position_reference"][:] = 0.3

    outcome = run("check", arm(still), "--config", config(), status=1)
    assert "no joint moves: the most is joint_" in outcome.error


def test_a_name_that_is_too_long_is_one_line(run, config, tmp_path: Path) -> None:
    outcome = run("check", tmp_path / ("b" * 300 + ".mcap"), "--config", config(), status=2)
    assert "too long" in outcome.error
    assert len(outcome.error.strip().splitlines()) == 1


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
