"""How far the RMS of a residual scatters, against closed forms of an autoregressive process."""

import numpy as np
import pytest
import scipy

from idim_iv_ros.statistics.residuals import largest_share, mean_square_freedom

RATE = 40.0


def autoregressive(rows: int, coefficient: float, seed: int) -> np.ndarray:
    noise = np.random.default_rng(seed).normal(size=rows + 200)
    return scipy.signal.lfilter([1.0], [1.0, -coefficient], noise)[200:]


@pytest.mark.parametrize("coefficient", [0.0, 0.6])
def test_freedom_is_that_of_an_autoregressive_process(coefficient: float) -> None:
    """Σ ρ_k² = (1 + φ²) / (1 - φ²): n rows are worth n (1 - φ²) / (1 + φ²)."""
    time = np.arange(8000) / RATE
    freedom = [mean_square_freedom(time, autoregressive(8000, coefficient, k)) for k in range(24)]
    expected = (1.0 - coefficient**2) / (1.0 + coefficient**2)
    # Each is from 200 seconds; above 1 it is cut off.
    assert np.mean(freedom) == pytest.approx(expected, rel=0.12)


def test_heavy_motion_at_times_lowers_the_freedom() -> None:
    time = np.arange(8000) / RATE
    residual = autoregressive(8000, 0.0, 1) * np.where(np.sin(time) > 0.0, 3.0, 1.0)
    freedom = mean_square_freedom(time, residual)
    # Independent rows of these two sizes: (E s²)² / E s⁴ = 25 / 41; their order lowers it more.
    assert freedom is not None and freedom < 25.0 / 41.0


def test_too_short_or_no_residual_says_nothing() -> None:
    time = np.arange(300) / RATE
    assert mean_square_freedom(time, autoregressive(300, 0.0, 1)) is None
    assert mean_square_freedom(np.arange(8000) / RATE, np.zeros(8000)) is None
    assert mean_square_freedom(np.zeros(0), np.zeros(0)) is None
    assert largest_share(1.0, 800, 0, 0.01) is None


def test_false_alarms_come_as_often_as_asked_for() -> None:
    """Ten seconds against twenty of an autocorrelated residual, 3,000 times."""
    coefficient, level, trials = 0.6, 0.01, 3000
    freedom = (1.0 - coefficient**2) / (1.0 + coefficient**2)
    limit = largest_share(freedom, 800, 400, level)
    series = autoregressive(trials * 1200, coefficient, 7).reshape(trials, 1200)
    rms = np.sqrt((series**2)[:, :800].mean(axis=1)), np.sqrt((series**2)[:, 800:].mean(axis=1))
    alarms = int(np.count_nonzero(rms[1] > limit * rms[0]))
    # Binomial(3000, 0.01): 30 ± 5.4; the tail of the sum is not exactly that of F.
    assert 12 <= alarms <= 55
    stronger = int(np.count_nonzero(1.5 * rms[1] > limit * rms[0]))
    assert stronger > 0.9 * trials


def test_uncertain_parameters_raise_the_limit() -> None:
    """Their error is one number for all rows: the ratio is then that of one degree of freedom."""
    limits = [largest_share(1.0, 10**7, 10**7, 0.01, errors) for errors in (0.0, 0.5, 2.0)]
    assert limits == sorted(limits)
    assert limits[0] == pytest.approx(1.0, abs=1e-2)
    # 1 + e z² with z normal: the quantile by its definition, against Satterthwaite's.
    exact = np.sqrt(1.0 + 2.0 * scipy.stats.norm.isf(0.005) ** 2)
    assert limits[2] == pytest.approx(exact, rel=0.1)
