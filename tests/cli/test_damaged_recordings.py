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


@pytest.mark.parametrize("jump", [0.3, 5e4])
def test_rest_is_named_beside_a_jump_of_a_sensor_too(run, config, arm, jump):
    def still(values) -> None:
        random = np.random.default_rng(0)
        values["position"][:] = random.normal(0.3, 1e-6, values["position"].shape)
        values["position"][1000, 1] = jump
        values["position_reference"][:] = 0.3

    outcome = run("check", arm(still), "--config", config(), status=1)
    assert "no joint moves: the most is joint_" in outcome.error


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
