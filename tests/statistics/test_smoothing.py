"""Curves of residuals."""

import numpy as np
import pytest
from scipy.signal import lfilter

from idim_iv_ros.statistics.curves import smooth


def test_a_smoothed_curve_follows_the_mean() -> None:
    random = np.random.default_rng(1)
    time = np.arange(20000) / 50.0
    x = np.sin(0.7 * time) + 0.3 * np.sin(1.9 * time)
    curve = smooth(x, 0.5 * x**2 + 0.1 * random.normal(size=len(x)), time)
    inner = np.abs(curve.x) < 0.9
    np.testing.assert_allclose(curve.mean[inner], 0.5 * curve.x[inner] ** 2, atol=0.02)


@pytest.mark.parametrize("memory", [0.0, 0.9])
def test_the_band_holds_the_mean_in_about_95_percent_though_samples_are_correlated(memory) -> None:
    random = np.random.default_rng(2)
    time = np.arange(4000) / 50.0
    inside = []
    for _ in range(60):
        phase = random.uniform(0.0, 6.0, 2)
        x = np.sin(0.9 * time + phase[0]) + 0.5 * np.sin(2.3 * time + phase[1])
        noise = lfilter([1.0], [1.0, -memory], random.normal(size=len(x)))
        curve = smooth(x, noise, time)
        certain = np.isfinite(curve.low) & (np.abs(curve.x) < 1.1)
        inside.append(np.mean((curve.low[certain] < 0.0) & (curve.high[certain] > 0.0)))
    assert 0.85 < np.mean(inside) < 0.99
