"""Held-out gaps against fits that are done the long way."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from idim_iv_ros.diagnosis.likelihood import Regression
from idim_iv_ros.diagnosis.refit.baseline import Baseline
from idim_iv_ros.diagnosis.refit.held_out import folds_of, held_out, shrinkage
from idim_iv_ros.diagnosis.refit.noise_floor import NoiseFloor, Repeat
from idim_iv_ros.estimation.rows import JointRows

ROWS, RATE = 600, 50.0


def _data(recordings: int) -> Baseline:
    motions = [SimpleNamespace(kept=np.ones((ROWS, 1), bool)) for _ in range(recordings)]
    data: Any = SimpleNamespace(
        motions=motions,
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
    floor = NoiseFloor(0.5, "repeats", "")
    tested = held_out(_data(3), regression, fit, ["+x[joint_1]"], [floor], given=np.zeros(3))
    assert tested.names == ("given", "refit", "+x[joint_1]")
    matrix = regression.extended[0].matrix
    torque = regression.joints[0].torque
    fold = np.repeat(np.arange(3), ROWS)
    for stage, width in ((1, 3), (2, 4)):
        for k in range(3):
            out = fold == k
            values = np.linalg.lstsq(matrix[~out, :width], torque[~out], rcond=None)[0]
            expected = torque[out] - matrix[out, :width] @ values
            np.testing.assert_allclose(tested.residuals[stage][0][out], expected, atol=2e-4)
    np.testing.assert_array_equal(tested.residuals[0][0], torque)
    gain, helped, folds = tested.gain(0)
    assert (helped, folds) == (3, 3)
    assert gain == pytest.approx(0.16 / 0.41, abs=0.05)


def test_folds_that_take_turns_span_the_session() -> None:
    folds, note = folds_of(_data(2), [], interleaved=True)
    assert set(folds[0]) == {0, 1, 2, 3}
    assert "every 4th block" in note
    for fold in range(4):
        places = np.flatnonzero(folds[0] == fold)
        assert places.min() < 0.5 * len(folds[0]) < places.max()
        assert len(places) > 0.1 * len(folds[0])


def test_shrinkage_reaches_the_floor_and_its_interval_covers_the_truth() -> None:
    floor = [NoiseFloor(0.5, "repeats", "")]
    true = np.sqrt(0.25 + 0.16)
    hits = 0
    for seed in range(40):
        regression = _regression(3, seed, 0.4)
        tested = held_out(_data(3), regression, regression.fit(steps=0), ["+x"], floor)
        gap = tested.gap(tested.refit, tested.refit + 1, 0)
        assert gap.before == pytest.approx(true, abs=0.06)
        assert gap.ci95 is not None
        hits += gap.ci95[0] <= 1.0 <= gap.ci95[1]
    assert hits >= 34


def test_an_effect_that_is_not_there_gains_nothing() -> None:
    regression = _regression(3, 7, 0.0)
    floor = NoiseFloor(None, "lower bound", "")
    tested = held_out(_data(3), regression, regression.fit(steps=0), ["+x"], [floor])
    assert abs(tested.gain(0)[0]) < 0.01
    gap = tested.gap(0, 1, 0)
    assert gap.noise_floor is None
    assert gap.shrinkage is not None
    assert abs(gap.shrinkage) < 0.01
    assert np.isnan(shrinkage(np.array(0.5), np.array(0.5), 0.5))
