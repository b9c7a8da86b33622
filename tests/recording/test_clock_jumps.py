"""Clocks that jump, stray stamps and long pauses: nothing is ever allocated for the hole."""

import tracemalloc
from pathlib import Path

import numpy as np
import pytest
import scipy.interpolate  # noqa: F401 - its import would count as memory of a reading

from idim_iv_ros.errors import DataError
from idim_iv_ros.recording.clock import on_one_clock
from idim_iv_ros.recording.read import read_recordings
from idim_iv_ros.recording.recording import Recording
from tests.recording.bag_writer import joint_state, write

RATE = 100.0
COUNT = 1000
STAMPS = 1.0 + np.arange(COUNT) / RATE
VALUES = np.sin(3.0 * STAMPS)
FEW_MEGABYTES = 5_000_000


def read(
    folder: Path, stamps, *, arrival=None, joints=("a",), reference: str | None = None
) -> tuple[Recording, str]:
    """Read joint states at these stamps, in little memory, and what is said of what was lost."""
    arrival = 5.0 + np.arange(len(stamps)) / RATE if arrival is None else arrival
    messages = [
        (topic, float(at), joint_state(stamp, ("a",), [value], (), [2.0 + value]))
        for stamp, at, value in zip(stamps, arrival, VALUES, strict=False)
        for topic in ("/joint_states", reference)
        if topic is not None
    ]
    bag = write(folder / "bag", messages)
    tracemalloc.start()
    try:
        (recording,) = read_recordings([bag], joints=joints, reference=reference)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < FEW_MEGABYTES
    return recording, "; ".join(note.sentence for note in recording.notes if note.limits)


def assert_measured(recording: Recording, expected: np.ndarray) -> None:
    """Every value that is said to be measured is one of `expected`, in their order."""
    measured = recording.position.values[~recording.position.invented[:, 0], 0]
    np.testing.assert_allclose(measured, expected, atol=1e-9)


@pytest.mark.parametrize("jump", [20.0, 3600.0, 1e9, 1.7e9])
def test_a_clock_that_jumps_is_named_and_the_longest_stretch_is_used(tmp_path, jump) -> None:
    stamps = STAMPS.copy()
    stamps[400:] += jump
    recording, said = read(tmp_path, stamps)
    assert recording.samples == 600
    assert_measured(recording, VALUES[400:])
    for words in ("/joint_states: at message 401", "from 4.990 s", "of 1000 messages 400 "):
        assert words in said
    assert f"to {stamps[400]:.3f} s" in said


@pytest.mark.parametrize("place", [0, 1, 300, COUNT - 1])
@pytest.mark.parametrize("stamp", [0.0, 1e6, 2.1e9])
def test_a_single_stray_stamp_costs_its_message_only(tmp_path, place, stamp) -> None:
    stamps = STAMPS + 1e5
    stamps[place] = stamp
    recording, said = read(tmp_path, stamps)
    first, last = (place == 0), COUNT - (place == COUNT - 1)
    assert recording.samples == last - first
    # A lone missing sample lies on the line between its neighbours.
    np.testing.assert_allclose(recording.position.values[:, 0], VALUES[first:last], atol=5e-4)
    assert f"at message {max(place, 1) + 1} the clock goes from " in said
    assert f" {stamp:.3f} s" in said
    assert "messages 1 that another clock" in said


def test_stray_stamps_in_a_row_and_everywhere_cost_their_messages_only(tmp_path: Path) -> None:
    random = np.random.default_rng(0)
    stray = random.choice(np.arange(2, COUNT - 2), 40, replace=False)
    stray = np.concatenate([stray, [500, 501, 502]])
    stamps = STAMPS.copy()
    stamps[stray] = random.uniform(1e4, 2e9, len(stray))
    recording, said = read(tmp_path, stamps)
    assert recording.samples == COUNT
    np.testing.assert_allclose(recording.position.values[:, 0], VALUES, atol=5e-3)
    assert recording.position.invented[500:503].all()
    kept = np.setdiff1d(np.arange(COUNT), stray)
    # One between two strays may be taken for another.
    assert np.isclose(recording.position.values[kept, 0], VALUES[kept]).sum() >= len(kept) - 3
    assert "jumps: of 1000 messages 4" in said


@pytest.mark.parametrize("stretch", [slice(300, 360), slice(500, 900)])
def test_a_stretch_on_another_clock_is_left_out_between_two_that_go_on(tmp_path, stretch) -> None:
    stamps = STAMPS.copy()
    stamps[stretch] += 1e9
    recording, _ = read(tmp_path, stamps)
    assert_measured(recording, np.delete(VALUES, np.arange(COUNT)[stretch]))


@pytest.mark.parametrize("pause", [15.0, 600.0, 20_000.0])
def test_both_sides_of_a_pause_are_used_and_the_pause_takes_no_memory(tmp_path, pause) -> None:
    stamps = STAMPS.copy()
    stamps[400:] += pause
    arrival = 4.0 + stamps
    recording, said = read(tmp_path, stamps, arrival=arrival, reference="/joint_reference")
    assert recording.samples == pytest.approx(COUNT + 10.0 * RATE, abs=2)
    assert_measured(recording, VALUES)
    np.testing.assert_array_equal(recording.position_reference.values, recording.position.values)
    assert f"{pause + 0.01:.4g} s, first 3.99 s" in said


def test_hardly_anything_but_holes_is_refused(tmp_path: Path) -> None:
    stamps = 1.0 + np.cumsum(np.where(np.arange(600) % 3, 0.01, 500.0))
    with pytest.raises(DataError, match="most of the recording is missing"):
        read(tmp_path, stamps, arrival=stamps)


def test_stamps_from_an_unset_clock_and_a_single_one_from_a_set_clock_mean_arrival(tmp_path):
    stamps = np.zeros(COUNT)
    stamps[700] = 1.7e9
    recording, _ = read(tmp_path, stamps)
    assert recording.clocks[0].source == "arrival"
    assert_measured(recording, VALUES)


@pytest.mark.parametrize("jump", [-400.0, 400.0])
@pytest.mark.parametrize("length", [1, 30])
def test_stray_stamps_are_left_out_where_they_are_times_of_arrival_too(jump, length) -> None:
    """Of a topic without a header, or of a bag that was converted."""
    time = (1e9 * (1000.0 + STAMPS)).astype(np.int64)
    stray = np.concatenate([np.arange(first, first + length) for first in (200, 600)])
    time[stray] += int(1e9 * jump)
    kept, notes = on_one_clock("/joint_states", time, time, 1e9 / RATE)
    np.testing.assert_array_equal(kept, np.delete(np.arange(COUNT), stray))
    assert len(notes) == 1
