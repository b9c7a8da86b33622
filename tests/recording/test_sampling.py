"""Stamps that jitter: whether the samples were taken so, the motion shows."""

import numpy as np
import pytest

from idim_iv_ros.recording.clock import sampling_times

RATE, SAMPLES, JITTER = 250.0, 15_000, 3e-4
START = 1_700_000_000_000_000_000  # ns


def recorded(share: float, *, lost: float = 0.01, noise: float = 2e-5, speed: float = 1.0):
    """Stamps and two joints sampled with a share of the stamps' jitter; true times in ns."""
    random = np.random.default_rng(1)
    regular = np.arange(SAMPLES) / RATE
    jitter = JITTER * random.normal(size=SAMPLES)
    sampled = regular + share * jitter
    position = np.column_stack(
        [np.sin(2.0 * speed * sampled), 0.5 * np.sin(5.0 * speed * sampled + 1.0)]
    )
    position += noise * random.normal(size=position.shape)
    kept = random.random(SAMPLES) >= lost
    stamps = START + np.rint(1e9 * (regular + jitter)).astype(np.int64)
    truth = START + np.rint(1e9 * sampled).astype(np.int64)
    return stamps[kept], position[kept], truth[kept]


@pytest.mark.parametrize("share", [0.0, 0.5])
def test_jitter_that_the_motion_does_not_show_is_taken_back(share: float) -> None:
    """A share of the jitter is that of samples which a second clock takes; 1 % of them are lost."""
    stamps, position, truth = recorded(share)
    times, shown = sampling_times(stamps, position)
    assert shown == pytest.approx(share, abs=0.01)
    errors = times - truth
    assert np.std(errors) < 0.1 * np.std(stamps - truth)
    assert abs(errors.mean()) < 1e4
    assert np.all(np.diff(times) > 0)


def test_messages_that_arrive_up_to_an_interval_late_are_taken_back() -> None:
    """Late by 1.2 ms at random, at 250 Hz: some come when the next one is due.

    Where that one is lost nothing tells which of the two has come.
    """
    random = np.random.default_rng(2)
    _, position, truth = recorded(0.0, lost=0.0)
    kept = random.random(SAMPLES) >= 0.01
    late = np.abs(random.normal(scale=1.2e6, size=SAMPLES)).astype(np.int64)
    stamps = np.maximum.accumulate(truth + late)[kept]
    times, shown = sampling_times(stamps, position[kept])
    assert shown == pytest.approx(0.0, abs=0.01)
    errors = times - truth[kept] - np.mean(times - truth[kept])
    told = np.abs(errors) < 0.5e9 / RATE
    assert np.mean(told) > 0.999
    assert np.std(errors[told]) < 0.1 * np.std(late)
    assert np.all(np.diff(times) > 0)


def test_stamps_of_samples_that_were_taken_late_are_kept() -> None:
    stamps, position, _ = recorded(1.0)
    times, shown = sampling_times(stamps, position)
    assert times is stamps and shown == 1.0


@pytest.mark.parametrize("hides", [{"speed": 0.0}, {"noise": 0.1}])
def test_a_motion_that_cannot_tell_keeps_the_stamps(hides) -> None:
    stamps, position, _ = recorded(0.0, **hides)
    assert sampling_times(stamps, position)[0] is stamps


def test_a_clock_without_whole_stretches_keeps_the_stamps() -> None:
    """Every fifth message is missing: nothing says what a smooth motion is."""
    stamps, position, _ = recorded(0.0, lost=0.0)
    kept = np.arange(SAMPLES) % 5 != 0
    assert sampling_times(stamps[kept], position[kept])[1] == 1.0


def test_regular_stamps_stay_bit_for_bit() -> None:
    _, position, _ = recorded(0.0, lost=0.0)
    stamps = START + (np.arange(SAMPLES) * round(1e9 / RATE)).astype(np.int64)
    assert sampling_times(stamps, position)[0] is stamps
