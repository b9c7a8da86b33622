"""RMS and its interval from blocks of time."""

import numpy as np
import pytest

from idim_iv_ros.statistics.bootstrap import energies, interval, resampled, roots


def test_interval_of_an_rms_covers_the_truth() -> None:
    random = np.random.default_rng(1)
    blocks = np.repeat(np.arange(40), 50)
    hits = 0
    for _ in range(200):
        low, high = interval(roots(resampled(energies(random.standard_normal(2000), blocks))))
        hits += low < 1.0 < high
    assert 0.88 <= hits / 200 <= 0.99


def test_blocks_add_up_to_the_rms_of_every_column() -> None:
    residuals = np.random.default_rng(2).standard_normal((90, 3))
    sums = energies(residuals, np.repeat([0, 3, 4], [20, 30, 40]))  # of which two have no rows
    assert sums[:, -1].tolist() == [20.0, 30.0, 40.0]
    rms = roots(sums.sum(axis=0))
    assert rms == pytest.approx(np.linalg.norm(residuals, axis=0) / np.sqrt(90.0))
