"""Curves and spectra of residuals."""

import numpy as np
import pytest
from scipy.signal import lfilter

from idim_iv_ros.statistics.curves import order_spectrum, smooth
from tests.report.sample_gap import sample_gap


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


def test_a_curve_of_nothing_is_empty() -> None:
    none = np.zeros(0)
    assert len(smooth(none, none, none).x) == 0
    assert len(smooth(np.ones(50), np.ones(50), np.arange(50.0)).x) == 0


def test_ripple_is_a_peak_at_its_wave_number_with_its_amplitude() -> None:
    series = sample_gap(2, "structural", seconds=120.0).series[1]
    residuals = [series.torque - series.refit, series.torque - series.extended]
    spectrum = order_spectrum(series.position, series.speed, residuals, series.step)
    assert spectrum is not None
    before, after = spectrum.amplitudes
    place = int(np.argmax(before))
    assert spectrum.wave_number[place] == pytest.approx(18.0, abs=0.5)
    assert before[place] == pytest.approx(0.35, rel=0.12)
    assert after.max() < 0.2 * before[place]


def test_a_joint_that_stands_still_has_no_spectrum() -> None:
    still = np.ones(100)
    assert order_spectrum(still, 0.0 * still, [still], 0.02) is None
    assert order_spectrum(np.zeros(0), np.zeros(0), [np.zeros(0)], 0.02) is None
