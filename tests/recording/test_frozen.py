"""Channels that hold their last value or only look like it, and what is put into gaps."""

from pathlib import Path

import numpy as np
import pytest

from idim_iv_ros.recording.frozen_channels import frozen_efforts, frozen_runs, moving_speed
from idim_iv_ros.recording.read import read_recordings
from idim_iv_ros.recording.writing.write import JointTopic, write_bag
from idim_iv_ros.types import BoolArray, FloatArray

STEP = 0.1  # N m, of a coarse effort


def _motion(rate: float = 1000.0) -> tuple[FloatArray, FloatArray]:
    """Fast, rest, a hundred times slower, fast again: position and smooth effort."""
    parts = (np.full(6000, 1.0), np.zeros(4000), np.full(8000, 0.01), np.full(6000, 1.0))
    phase = np.cumsum(np.concatenate(parts)) / 1000.0
    q = np.sin(2.0 * np.pi * 0.4 * phase) + 0.3 * np.cos(2.0 * np.pi * 1.1 * phase)
    effort = 9.0 * np.cos(q) + 4.0 * np.sin(2.0 * np.pi * 1.1 * phase)
    every = round(1000.0 / rate)
    return q[::every], effort[::every]


def _counts(values: FloatArray, step: float) -> FloatArray:
    return np.asarray(np.round(values / step) * step)


def _frozen(values: FloatArray, starts, length: int) -> tuple[FloatArray, BoolArray]:
    frozen, where = values.copy(), np.zeros(len(values), dtype=bool)
    for start in starts:
        frozen[start : start + length] = frozen[start - 1]
        where[start : start + length] = True
    return frozen, where


@pytest.mark.parametrize("rate", [1000.0, 250.0, 50.0])
@pytest.mark.parametrize("noise", [0.0, 0.1, 0.3, 0.5, 1.0, 3.0])
@pytest.mark.parametrize("step", [0.0, 0.01, STEP, 1.0])
@pytest.mark.parametrize("count", [0.0, 1e-4, 1e-3])
def test_a_coarse_channel_is_not_frozen_at_rest_in_creep_or_in_motion(rate, noise, step, count):
    position, effort = _motion(rate)
    effort = effort + noise * (step or STEP) * np.random.default_rng(3).normal(size=len(effort))
    effort = _counts(effort, step) if step else effort
    position = _counts(position, count) if count else position
    speed = moving_speed(position)
    assert not frozen_efforts(effort, position, speed).any()
    assert not frozen_runs(position, position, speed, jumps=True).any()


@pytest.mark.parametrize(("step", "length"), [(0.0, 20), (0.0, 80), (STEP, 80)])
def test_an_effort_that_freezes_is_found_to_the_sample(step: float, length: int) -> None:
    position, effort = _motion()
    effort = effort + STEP * np.random.default_rng(5).normal(size=len(effort))
    effort = _counts(effort, step) if step else effort
    speed = np.abs(position[length:] - position[:-length])
    starts = [start for start in range(200, 5800, 300) if speed[start] > 0.1 * speed.max()]
    assert len(starts) > 7
    frozen, where = _frozen(effort, starts, length)
    marked = frozen_efforts(frozen, position, moving_speed(position))
    # By chance a coarse channel has the held value before and after, or soon again.
    close = where | np.roll(where, 2) | np.roll(where, -2)
    assert marked[where].mean() > (0.99 if step == 0.0 else 0.9)
    assert not marked[~close].any()


def test_an_effort_that_is_updated_more_slowly_than_it_is_published_is_not_frozen() -> None:
    position, effort = _motion()
    random = np.random.default_rng(7)
    effort = effort + STEP * random.normal(size=len(effort))
    source = np.repeat(effort[::4], 4)
    assert not frozen_efforts(source, position, moving_speed(position)).any()
    late = np.sort(random.choice(len(effort), len(effort) // 4, replace=False))
    irregular = effort[late[np.maximum(np.searchsorted(late, np.arange(len(effort))) - 1, 0)]]
    assert frozen_efforts(irregular, position, moving_speed(position)).mean() < 2e-3


def test_an_effort_at_its_limit_is_not_frozen() -> None:
    position, effort = _motion()
    noisy = effort + STEP * np.random.default_rng(9).normal(size=len(effort))
    clipped = np.clip(noisy, -4.0, 7.0)
    assert (clipped == 7.0).mean() > 0.1
    assert not frozen_efforts(clipped, position, moving_speed(position)).any()


def test_a_joint_that_never_moves_has_no_frozen_channel() -> None:
    still = np.full(2000, 0.3)
    effort = _counts(np.linspace(0.0, 5.0, 2000), STEP)
    assert not frozen_efforts(effort, still, moving_speed(still)).any()
    assert not frozen_runs(still, still, moving_speed(still), jumps=True).any()
    missing = np.full(2000, np.nan)
    assert not frozen_efforts(missing, missing, moving_speed(missing)).any()


def test_frozen_samples_of_a_bag_are_invented_and_reported(tmp_path: Path) -> None:
    position, effort = _motion()
    effort = effort + STEP * np.random.default_rng(5).normal(size=len(effort))
    frozen, where = _frozen(effort, (2500, 5000), 60)
    other = effort + np.random.default_rng(1).normal(size=len(effort))
    states, efforts = np.column_stack([position, position]), np.column_stack([frozen, other])
    time = 100.0 + np.arange(len(position)) / 1000.0
    topic = JointTopic("/joint_states", ["a", "b"], time, states, None, efforts)
    write_bag(tmp_path / "one.mcap", [topic])
    (recording,) = read_recordings([tmp_path / "one.mcap"], joints=["a", "b"])
    np.testing.assert_array_equal(recording.effort.invented[:, 0], where)
    assert not recording.effort.invented[:, 1].any()
    assert not recording.position.invented.any()
    gap = np.linspace(0.0, 1.0, 62)[1:-1]
    bridge = effort[2499] + gap * (effort[2560] - effort[2499])
    np.testing.assert_allclose(recording.effort.values[2500:2560, 0], bridge, atol=1e-6)
    (stretches,) = recording.frozen
    assert (stretches.samples, stretches.stretches) == (120, 2)
    assert stretches.first == pytest.approx(2.499, abs=1e-6)
    assert stretches.longest == pytest.approx(0.06, abs=1e-6)


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
