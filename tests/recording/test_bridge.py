"""What is put into gaps of a position has no corners, whatever the length of the gap."""

import numpy as np
import pytest

from idim_iv_ros.recording import JointTopic, read_recordings, write_bag

RATE = 500.0
TIME = np.arange(8000) / RATE
POSITION = np.sin(2.0 * TIME) + 0.4 * np.cos(5.0 * TIME)
LARGEST = 4.0 + 10.0  # rad/s², of this motion


@pytest.mark.parametrize("length", [0.02, 0.5, 2.5, 9.0])
@pytest.mark.parametrize("noise", [0.0, 1e-6])
def test_a_gap_has_no_acceleration_that_the_joint_never_had(tmp_path, length, noise) -> None:
    time = TIME.copy()
    kept = np.ones(len(time), dtype=bool)
    if length < 5.0:
        kept[3003 : 3003 + round(length * RATE)] = False
    else:
        time[3003:] += length
    measured = POSITION + noise * np.random.default_rng(0).normal(size=len(time))
    both = np.column_stack([measured, measured])[kept]
    effort = 1.0 + np.random.default_rng(1).normal(size=both.shape)
    topic = JointTopic("/joint_states", ["a", "b"], time[kept], both, None, effort)
    write_bag(tmp_path / "b.mcap", [topic])
    (recording,) = read_recordings([tmp_path / "b.mcap"], joints=["a", "b"])
    position, invented = recording.position.values[:, 0], recording.position.invented[:, 0]
    assert invented.sum() == pytest.approx(length * RATE, abs=2)
    np.testing.assert_allclose(position[~invented], measured[kept], atol=1e-9)
    acceleration = np.gradient(np.gradient(position, 1.0 / RATE), 1.0 / RATE)
    edge = np.convolve(invented, np.ones(5), mode="same") > 0
    # The speeds at the edges come from some samples on one side.
    speed_error = 0.02 * LARGEST + 100.0 * noise
    assert np.abs(acceleration[edge]).max() < 2.0 * LARGEST + speed_error * RATE
    straight = np.interp(np.arange(len(position)), np.flatnonzero(~invented), position[~invented])
    corner = np.abs(np.diff(straight, 2)).max() * RATE**2
    if length > 0.1:
        assert np.abs(acceleration[edge]).max() < 0.3 * corner
