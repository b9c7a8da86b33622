"""Noise of the rows: torque that sampling missed, and noise that is larger where a torque acts."""

import numpy as np
import pytest

from idim_iv_ros.diagnosis.comparison.ledger import RowNoise, scale_of
from idim_iv_ros.signals import AutoregressiveModel


def test_rows_beside_a_shock_weigh_as_much_as_the_torque_that_was_missed_there() -> None:
    rng = np.random.default_rng(1)
    residual = 0.1 * rng.normal(size=2000)
    unsampled = 0.05 * rng.normal(size=2000)
    assert scale_of(residual, unsampled).mean() < 1.001  # nothing is missed
    unsampled[700:703] = [1.0, -2.0, 1.0]
    scale = scale_of(residual, unsampled)
    assert scale[[700, 701, 702]] == pytest.approx([10.0, 20.0, 10.0], rel=0.1)
    assert np.median(scale) == 1.0


def test_noise_of_a_scale_is_white_after_both_are_taken_out() -> None:
    rng = np.random.default_rng(2)
    model = AutoregressiveModel(np.array([-0.8]), 0.04)
    scale = np.where(np.arange(4000) < 2000, 1.0, 5.0)
    noise = np.zeros(4000)
    for k in range(1, 4000):
        noise[k] = 0.8 * noise[k - 1] + 0.2 * rng.normal()
    white = RowNoise(model, scale).standardized((scale * noise)[:, None], (slice(0, 4000),))[:, 0]
    for part in (white[100:2000], white[2000:]):
        assert part.std() == pytest.approx(1.0, abs=0.05)
    assert abs(np.corrcoef(white[1:], white[:-1])[0, 1]) < 0.05
