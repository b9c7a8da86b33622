"""Where the gap lies, on residuals whose answer is known by construction."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from idim_iv_ros.diagnosis.refit.baseline import Baseline
from idim_iv_ros.diagnosis.refit.held_out import folds_of, held_out, row_blocks, time_blocks
from idim_iv_ros.diagnosis.refit.noise_floor import Repeat, difference_energy, find_repeats
from idim_iv_ros.diagnosis.where import (
    Axis,
    axes_of,
    in_words,
    joined,
    lifts,
    regimes_of,
    since_reversal,
    split,
)
from idim_iv_ros.estimation.likelihood import Regression
from idim_iv_ros.estimation.rows import JointRows
from idim_iv_ros.recording.recording import SessionPart
from idim_iv_ros.statistics.bootstrap import block_sums


@pytest.mark.parametrize(
    ("seconds", "length", "blocks"),
    [
        ((5, 50), None, (1, 10)),  # of 5 s
        ((8, 8), None, (4, 4)),  # a short session has 8
        ((2, 2), None, (2, 2)),  # of a second at least
        ((5, 50), 1.0, (5, 50)),
    ],
)
def test_blocks_last_five_seconds_and_do_not_reach_into_the_next_recording(seconds, length, blocks):
    first, second = time_blocks([100 * duration for duration in seconds], 100.0, length)
    assert (len(np.unique(first)), len(np.unique(second))) == blocks
    assert not set(first) & set(second)


def test_displacement_of_a_sine_since_it_turned() -> None:
    time = np.arange(0.0, 10.0, 1e-3)
    position = np.sin(time)
    noise = 1e-4 * np.random.default_rng(2).standard_normal(len(time))
    distance = since_reversal(position, np.cos(time) + noise, 0.01)
    after = (time > np.pi / 2 + 0.1) & (time < 3 * np.pi / 2 - 0.1)
    np.testing.assert_allclose(distance[after], 1.0 - position[after], atol=1e-3)


def test_energy_in_one_bin_is_found_there() -> None:
    random = np.random.default_rng(3)
    speed = random.permutation((np.arange(4000) + 0.5) / 4000)
    residual = random.standard_normal(4000) * np.where(speed < 0.1, 3.0, 1.0)
    axis = Axis("speed", speed, np.linspace(0.0, 1.0, 11))
    bins = split(axis, residual**2, np.arange(4000) // 100)
    energy, occupancy, _, limits = lifts(bins)
    # 9 · 0.1 of 9 · 0.1 + 0.9
    assert energy[0] == pytest.approx(0.5, abs=0.04)
    assert occupancy[0] == pytest.approx(0.1, abs=1e-9)
    assert limits[0, 0] < 5.0 < limits[0, 1]
    assert regimes_of("joint_2", axis, bins, "rad/s")[0].low == 0.0
    assert energy.sum() == pytest.approx(1.0)


def test_lift_of_noise_excludes_one_about_as_often_as_it_says() -> None:
    random = np.random.default_rng(4)
    outside = 0
    for _ in range(100):
        values, residual = random.uniform(0.0, 1.0, 2000), random.standard_normal(2000)
        axis = Axis("load", values, np.linspace(0.0, 1.0, 5))
        limits = lifts(split(axis, residual**2, np.arange(2000) // 50))[3]
        outside += int(np.sum((limits[:, 0] > 1.0) | (limits[:, 1] < 1.0)))
    assert outside / 400 < 0.12


def _reference(seed: int, seconds: float) -> np.ndarray:
    time = np.arange(0.0, seconds, 1e-3)[:, None]
    phase = np.random.default_rng(seed).uniform(0.0, 6.0, (1, 2, 6))
    waves = 2 * np.pi * np.array([0.13, 0.29, 0.41, 0.67, 0.9, 1.3]) * time[:, :, None]
    return np.sin(waves[:, None, 0, :] + phase).sum(axis=2)


def test_repeats_are_found_with_their_shift_and_others_are_not() -> None:
    one, other = _reference(1, 12.0), _reference(2, 12.0)
    later = one[1234:]
    repeats = find_repeats([one, other, later], 1000.0, 50.0)
    assert [(r.first, r.second) for r in repeats] == [(0, 2)]
    assert repeats[0].lag == -1234


@pytest.mark.parametrize(("seconds", "periods"), [(4.0, 3.0), (10.0, 1.25)])
def test_periods_inside_a_recording_are_found(seconds: float, periods: float) -> None:
    period = round(1000 * seconds)
    one = _reference(3, seconds) * np.sin(np.pi * np.arange(period) / period)[:, None]
    whole = np.concatenate([one, one, one])[: round(periods * period)]
    repeats = find_repeats([whole], 1000.0, 50.0)
    assert [(r.first, r.second) for r in repeats] == [(0, 0)]
    assert repeats[0].lag == period


def test_drift_between_repeats_is_not_noise() -> None:
    random = np.random.default_rng(6)
    direction = np.sign(np.sin(np.arange(3000) / 50.0))
    noise = 0.2 * random.standard_normal((2, 3000))
    difference = noise[0] - noise[1] + 0.5 * direction + 0.3
    energy, degrees = difference_energy(difference, direction[:, None])
    assert degrees == 2998
    assert np.sqrt(0.5 * energy / degrees) == pytest.approx(0.2, rel=0.04)


@pytest.mark.parametrize("recordings", [1, 2, 3, 9])
def test_a_stretch_of_time_lies_in_recordings_that_are_named(recordings: int) -> None:
    """Ten seconds each; the residual is three times as large in the last 40 % of the last one."""
    random = np.random.default_rng(7)
    rows = 1000
    parts = [SessionPart(f"run{k}.mcap", 20.0 * k, 10.0) for k in range(recordings)]
    starts = [part.start for part in parts]
    time = np.concatenate([start + np.arange(rows) / 100.0 for start in starts])
    which = np.repeat(np.arange(recordings), rows)
    loud = time >= starts[-1] + 6.0
    residual = random.standard_normal(len(time)) * np.where(loud, 3.0, 1.0)
    other = random.uniform(0.1, 1.0, len(time))
    names = ("position", "speed", "load", "since_reversal")
    axes = axes_of({"time": time, **dict.fromkeys(names, other)}, starts)
    axis = next(one for one in axes if one.name == "time")
    if 1 < recordings < 6:  # no bin holds rows of two recordings
        place = np.searchsorted(axis.edges, time, side="right")
        assert all(len(set(which[place == k])) == 1 for k in set(place[:-1]))
    blocks = np.concatenate(time_blocks([rows] * recordings, 100.0, 1.0))
    bins = split(axis, residual**2, blocks)
    best = joined(regimes_of("joint_2", axis, bins, "s"))
    assert best is not None
    sentence = in_words(best, axis.edges, parts)
    assert f"s of run{recordings - 1}.mcap: " in sentence
    assert "session" not in sentence
    if recordings < 4:
        start, end = sentence.split("from ")[1].split(" s of ")[0].split(" to ")
        assert 4.0 < float(start) < 7.0
        assert 9.9 < float(end) <= 10.0


ROWS, RATE = 600, 50.0


def _data(recordings: int, given: np.ndarray | None = None) -> Baseline:
    motions = [SimpleNamespace(kept=np.ones((ROWS, 1), bool)) for _ in range(recordings)]
    data: Any = SimpleNamespace(
        motions=motions,
        prepared=SimpleNamespace(given=given),
        of_joints=lambda values: (np.concatenate(values),),
        row_rate=RATE,
        joints=("joint_1",),
        recordings=(np.repeat(np.arange(recordings), ROWS),),
        places=(np.tile(np.arange(ROWS), recordings),),
    )
    return cast(Baseline, data)


def _regression(recordings: int, seed: int, size: float) -> Regression:
    random = np.random.default_rng(seed)
    rows = ROWS * recordings
    matrix, extra = random.standard_normal((rows, 3)), random.standard_normal((rows, 1))
    torque = matrix @ [1.0, -2.0, 0.5] + size * extra[:, 0] + 0.5 * random.standard_normal(rows)
    segments = tuple(slice(k * ROWS, (k + 1) * ROWS) for k in range(recordings))
    joint = JointRows(matrix, torque, np.arange(3), segments)
    return Regression((joint,), 3).with_columns({0: extra})


def test_recordings_are_folds_and_repeats_share_one() -> None:
    folds, note = folds_of(_data(4), [Repeat(0, 2, 0)])
    assert len(np.unique(folds[0])) == 3
    assert folds[0][0] == folds[0][2 * ROWS]
    assert "3 recordings" in note


def test_folds_of_one_recording_are_its_quarters() -> None:
    folds, _ = folds_of(_data(1), [])
    np.testing.assert_array_equal(folds[0], np.repeat(np.arange(4), ROWS // 4))


def test_predictions_are_those_of_a_fit_without_the_fold() -> None:
    regression = _regression(3, 1, 0.4)
    fit = regression.fit(steps=0)
    tested = held_out(_data(3, np.zeros(3)), regression, fit, ["+x[joint_1]"])
    assert [stage.name for stage in tested.stages] == ["given", "refit", "+x[joint_1]"]
    matrix = regression.extended[0].matrix
    torque = regression.joints[0].torque
    fold, (blocks,) = np.repeat(np.arange(3), ROWS), row_blocks(_data(3))
    for stage, width in ((1, 3), (2, 4)):
        expected = torque.copy()
        for k in range(3):
            out = fold == k
            values = np.linalg.lstsq(matrix[~out, :width], torque[~out], rcond=None)[0]
            expected[out] -= matrix[out, :width] @ values
        sums = tested.sums[stage][0][:, 0]
        np.testing.assert_allclose(sums, block_sums(blocks, expected**2), rtol=1e-3)
    np.testing.assert_array_equal(tested.sums[0][0][:, 0], block_sums(blocks, torque**2))
    gain, helped, folds = tested.gains[0]
    assert (helped, folds) == (3, 3)
    assert gain == pytest.approx(0.16 / 0.41, abs=0.05)


def test_shrinkage_reaches_the_floor_and_its_interval_covers_the_truth() -> None:
    true = np.sqrt(0.25 + 0.16)
    hits = 0
    for seed in range(40):
        regression = _regression(3, seed, 0.4)
        tested = held_out(_data(3), regression, regression.fit(steps=0), ["+x"])
        gap = tested.gap(0, 0, 0.5)
        assert gap.before == pytest.approx(true, abs=0.06)
        assert gap.ci95 is not None
        hits += gap.ci95[0] <= 1.0 <= gap.ci95[1]
    assert hits >= 34
