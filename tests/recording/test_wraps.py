"""Positions that a driver wraps into one turn, and jumps that are no wraps."""

from pathlib import Path

import numpy as np
import pytest

from idim_iv_ros.recording.read import read_recordings
from idim_iv_ros.recording.recording import Recording
from idim_iv_ros.recording.wraps import unwrapped
from idim_iv_ros.recording.writing.write import JointTopic, write_bag
from idim_iv_ros.types import FloatArray

TURN = 2.0 * np.pi
RATE = 200.0
TIME = 50.0 + np.arange(4000) / RATE
# Passes ±π many times, turns around there, and rests on it.
TURNING = np.pi + 2.4 * np.sin(0.9 * TIME) + 0.5 * np.sin(3.1 * TIME)
NANOSECONDS = np.round(TIME * 1e9).astype(np.int64)
URDF = '<robot name="r"><joint name="a" type="{}"/><joint name="b" type="revolute"/></robot>'


def into_pi(angle: FloatArray) -> FloatArray:
    return np.asarray((angle + np.pi) % TURN - np.pi)


def into_turn(angle: FloatArray) -> FloatArray:
    return np.asarray(angle % TURN)


def read(
    path: Path,
    position: FloatArray,
    reference: FloatArray | None = None,
    kept=slice(None),
    kind: str = "continuous",
    prismatic=(),
) -> Recording:
    other = 0.5 * np.sin(TIME)
    both = np.column_stack([position, other])
    effort = 3.0 + np.random.default_rng(0).normal(size=both.shape)
    topics = [JointTopic("/joint_states", ["a", "b"], TIME[kept], both[kept], None, effort[kept])]
    if reference is not None:
        both = np.column_stack([reference, other])
        topics.append(JointTopic("/joint_reference", ["a", "b"], TIME, both))
    write_bag(path, topics, robot_description=URDF.format(kind))
    name = None if reference is None else "/joint_reference"
    return read_recordings([path], joints=["a", "b"], reference=name, prismatic=prismatic)[0]


def assert_continuous(values: FloatArray, truth: FloatArray, tolerance: float = 1e-9) -> None:
    """Same motion, up to a number of whole turns that never changes."""
    turns = np.round((values - truth) / TURN)
    assert np.ptp(turns) == 0
    np.testing.assert_allclose(values - TURN * turns, truth, atol=tolerance)


@pytest.mark.parametrize("wrap", [into_pi, into_turn])
@pytest.mark.parametrize("noise", [0.0, 1e-4, 1e-3])
def test_a_wrapped_position_becomes_continuous(tmp_path: Path, wrap, noise: float) -> None:
    shift = 0.0 if wrap is into_pi else np.pi
    truth = TURNING + shift + noise * np.random.default_rng(1).normal(size=len(TIME))
    recording = read(tmp_path / "b.mcap", wrap(truth))
    assert_continuous(recording.position.values[:, 0], truth)
    (note,) = [n for n in recording.notes if "wraps" in n.what]
    assert "of a wraps" in note.what
    assert not recording.position.invented.any()


@pytest.mark.parametrize("slow", [1, 4, 10])
def test_slow_sampling_of_a_fast_joint_is_unwrapped(slow: int) -> None:
    continuous = unwrapped(NANOSECONDS[::slow], into_pi(TURNING)[::slow])
    assert continuous.wraps
    assert_continuous(continuous.position, TURNING[::slow])


@pytest.mark.parametrize("length", [20, 100, 600])
def test_a_wrap_in_a_gap_leaves_no_turn_behind(tmp_path: Path, length: int) -> None:
    edge = int(np.flatnonzero(np.abs(np.diff(into_pi(TURNING))) > 6.0)[3])
    kept = np.ones(len(TIME), dtype=bool)
    kept[edge - length // 2 : edge + length // 2] = False
    recording = read(tmp_path / "b.mcap", into_pi(TURNING), into_pi(TURNING), kept)
    measured = ~recording.position.invented[:, 0]
    position = recording.position.values[:, 0]
    assert np.abs(np.diff(position)[measured[1:] & measured[:-1]]).max() < 0.05
    assert np.abs(np.diff(position)).max() < np.pi  # nor while nothing was measured
    turns = (position - TURNING)[measured] / TURN
    np.testing.assert_allclose(turns, np.round(turns), atol=1e-9)
    reference = recording.position_reference.values[:, 0]
    np.testing.assert_allclose(reference[measured], position[measured], atol=1e-9)


@pytest.mark.parametrize("shown", [into_pi, into_turn, lambda angle: angle, lambda a: a + 2 * TURN])
@pytest.mark.parametrize("measured", [into_pi, lambda angle: angle])
def test_the_reference_is_in_the_turn_of_the_position(tmp_path: Path, shown, measured) -> None:
    ahead = TURNING + 0.02 * np.cos(TIME)
    recording = read(tmp_path / "b.mcap", measured(TURNING), shown(ahead))
    lag = recording.position_reference.values[:, 0] - recording.position.values[:, 0]
    np.testing.assert_allclose(lag, ahead - TURNING, atol=1e-9)


def test_a_reference_that_steps_far_ahead_stays_ahead(tmp_path: Path) -> None:
    """A command of four rad at once is no wrap, though the other way around were shorter."""
    wanted = np.where((TIME > 55.0) & (TIME < 60.0), 6.0, 2.0)
    lag = np.convolve(wanted, np.ones(400) / 400.0)[: len(TIME)]
    lag[:400] = 2.0
    recording = read(tmp_path / "b.mcap", into_pi(lag), into_pi(wanted))
    error = recording.position_reference.values[:, 0] - recording.position.values[:, 0]
    # Only full turns may differ where the command itself came wrapped.
    away = (error - (wanted - lag)) / TURN
    np.testing.assert_allclose(away, np.round(away), atol=1e-9)
    assert np.abs(error[TIME < 55.0]).max() < 1e-9


@pytest.mark.parametrize("jump", [1.0, 3.0, 5.0, 6.0, 6.2, 6.6])
def test_a_real_jump_is_kept(jump: float) -> None:
    position = 0.01 * np.sin(TIME)
    position[2000:] -= jump
    continuous = unwrapped(NANOSECONDS, position)
    assert continuous.wraps == 0
    assert continuous.position is position


@pytest.mark.parametrize("told", ["by the bag", "by the caller"])
def test_a_prismatic_joint_has_no_turns(tmp_path: Path, told: str) -> None:
    wrapped = into_pi(TURNING)
    recording = read(
        tmp_path / "b.mcap",
        wrapped,
        kind="prismatic" if told == "by the bag" else "revolute",
        prismatic=["a"] if told == "by the caller" else [],
    )
    np.testing.assert_array_equal(recording.position.values[:, 0], wrapped)
