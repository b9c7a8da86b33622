"""What a residual is: its autocorrelation, its distribution, and how far its RMS scatters."""

import numpy as np
import pytest
import scipy
from statsmodels.stats.diagnostic import acorr_ljungbox
from statsmodels.stats.stattools import jarque_bera
from statsmodels.tsa.stattools import acf

from idim_iv_ros.statistics.residuals import (
    autocorrelation,
    diagnose_residual,
    largest_share,
    ljung_box,
    mean_square_freedom,
)
from tests.statistics.worlds import autoregressive, joint_rows


def joint_with(residual, runs=None, seed=0):
    """One joint with three slow columns whose residual at β = 1 is `residual`."""
    rng = np.random.default_rng(seed)
    time = np.arange(len(residual))[:, None]
    z = np.sin(rng.uniform(0.005, 0.02, 3) * 2 * np.pi * time + rng.uniform(0, 6, 3))
    runs = runs or [slice(0, len(residual))]
    return joint_rows("joint", z, z, z.sum(axis=1) + residual, np.arange(3), runs)


def test_autocorrelated_residual_is_autocorrelated_and_its_filter_whitens_it():
    residual = autoregressive(np.random.default_rng(2), [-1.5, 0.7], (4000,))
    diagnosis = diagnose_residual(joint_with(residual), np.ones(3))
    assert diagnosis.white is False
    assert diagnosis.ar_order >= 2
    assert diagnosis.whiteness.accepted is False
    assert diagnosis.whiteness_after.accepted
    assert diagnosis.largest_correlation_after < 0.06


def test_understatement_of_slow_columns_under_ar1_is_the_analytic_one():
    """At frequency 0 the ratio of AR(1) is √((1 + φ) / (1 − φ)), 3 for φ = 0.8."""
    residual = autoregressive(np.random.default_rng(3), [-0.8], (40_000,))
    rows = joint_with(residual)
    constant = np.ones((len(residual), 1))
    rows = joint_rows("joint", constant, constant, 1.0 + residual, np.arange(1), rows.segments)
    diagnosis = diagnose_residual(rows, np.ones(1))
    assert diagnosis.sigma_understatement == pytest.approx(3.0, rel=0.05)


def test_heavy_tails_are_not_gaussian_and_the_effect_size_says_how_heavy():
    residual = np.random.default_rng(5).laplace(size=20_000)
    diagnosis = diagnose_residual(joint_with(residual), np.ones(3))
    assert diagnosis.normality.accepted is False
    assert diagnosis.excess_kurtosis == pytest.approx(3.0, abs=0.5)
    assert diagnosis.skewness == pytest.approx(0.0, abs=0.15)


def test_ljung_box_and_jarque_bera_are_those_of_statsmodels():
    residual = np.random.default_rng(6).standard_normal(700)
    residual -= residual.mean()
    test = ljung_box(residual, [slice(0, 700)], "white", "joint", 15, 3)
    oracle = acorr_ljungbox(residual, lags=[15], model_df=3).iloc[0]
    assert test.statistic == pytest.approx(oracle.lb_stat)
    assert test.p_value == pytest.approx(oracle.lb_pvalue)
    rows = joint_with(residual)
    diagnosis = diagnose_residual(rows, np.ones(3))
    white = diagnosis.autoregression.whiten(residual, rows.segments)
    statistic, p_value, *_ = jarque_bera(white)
    assert diagnosis.normality.statistic == pytest.approx(statistic)
    assert diagnosis.normality.p_value == pytest.approx(p_value)


def test_autocorrelation_of_one_run_is_that_of_statsmodels_and_of_many_skips_the_breaks():
    series = autoregressive(np.random.default_rng(7), [-0.9], (500,))
    np.testing.assert_allclose(autocorrelation(series, [slice(0, 500)], 30), acf(series, nlags=30))
    runs = [slice(0, 120), slice(120, 500)]
    centred = series - series.mean()
    pairs = sum(centred[r][1:] @ centred[r][:-1] for r in runs)
    assert autocorrelation(series, runs, 1)[1] == pytest.approx(pairs / (centred @ centred))


def test_ljung_box_of_many_short_runs_keeps_its_size():
    runs = [slice(25 * i, 25 * i + 25) for i in range(20)]
    series = np.random.default_rng(8).standard_normal((600, 500))
    tests = [ljung_box(row, runs, "white", "joint", 15) for row in series]
    assert 0.02 < np.mean([not test.accepted for test in tests]) < 0.085


def test_too_few_or_constant_rows_are_a_value_with_a_reason():
    few = diagnose_residual(joint_with(np.ones(10)), np.ones(3))
    assert few.white is None
    assert "10 rows" in few.whiteness.reason
    assert few.normality.accepted is None
    exact = diagnose_residual(joint_with(np.zeros(200)), np.ones(3))
    assert exact.rms == pytest.approx(0.0, abs=1e-12)
    assert exact.relative_percent == pytest.approx(0.0, abs=1e-9)
    silent = joint_rows(
        "joint", np.zeros((50, 1)), np.zeros((50, 1)), np.zeros(50), np.arange(1), [slice(0, 50)]
    )
    assert diagnose_residual(silent, np.ones(1)).relative_percent is None


RATE = 40.0


def residual_of(rows: int, coefficient: float, seed: int) -> np.ndarray:
    noise = np.random.default_rng(seed).normal(size=rows + 200)
    return scipy.signal.lfilter([1.0], [1.0, -coefficient], noise)[200:]


@pytest.mark.parametrize("coefficient", [0.0, 0.6])
def test_freedom_is_that_of_an_autoregressive_process(coefficient: float) -> None:
    """Σ ρ_k² = (1 + φ²) / (1 - φ²): n rows are worth n (1 - φ²) / (1 + φ²)."""
    time = np.arange(8000) / RATE
    freedom = [mean_square_freedom(time, residual_of(8000, coefficient, k)) for k in range(24)]
    expected = (1.0 - coefficient**2) / (1.0 + coefficient**2)
    # Each is from 200 seconds; above 1 it is cut off.
    assert np.mean(freedom) == pytest.approx(expected, rel=0.12)


def test_heavy_motion_at_times_lowers_the_freedom() -> None:
    time = np.arange(8000) / RATE
    residual = residual_of(8000, 0.0, 1) * np.where(np.sin(time) > 0.0, 3.0, 1.0)
    freedom = mean_square_freedom(time, residual)
    # Independent rows of these two sizes: (E s²)² / E s⁴ = 25 / 41; their order lowers it more.
    assert freedom is not None and freedom < 25.0 / 41.0


def test_too_short_or_no_residual_says_nothing() -> None:
    time = np.arange(300) / RATE
    assert mean_square_freedom(time, residual_of(300, 0.0, 1)) is None
    assert mean_square_freedom(np.arange(8000) / RATE, np.zeros(8000)) is None
    assert mean_square_freedom(np.zeros(0), np.zeros(0)) is None
    assert largest_share(1.0, 800, 0, 0.01) is None


def test_false_alarms_come_as_often_as_asked_for() -> None:
    """Ten seconds against twenty of an autocorrelated residual, 3,000 times."""
    coefficient, level, trials = 0.6, 0.01, 3000
    freedom = (1.0 - coefficient**2) / (1.0 + coefficient**2)
    limit = largest_share(freedom, 800, 400, level)
    series = residual_of(trials * 1200, coefficient, 7).reshape(trials, 1200)
    rms = np.sqrt((series**2)[:, :800].mean(axis=1)), np.sqrt((series**2)[:, 800:].mean(axis=1))
    # Binomial(3000, 0.01): 30 ± 5.4; the tail of the sum is not exactly that of F.
    assert 12 <= int(np.count_nonzero(rms[1] > limit * rms[0])) <= 55
    assert int(np.count_nonzero(1.5 * rms[1] > limit * rms[0])) > 0.9 * trials


def test_uncertain_parameters_raise_the_limit() -> None:
    """Their error is one number for all rows: the ratio is then that of one degree of freedom."""
    limits = [largest_share(1.0, 10**7, 10**7, 0.01, errors) for errors in (0.0, 0.5, 2.0)]
    assert limits == sorted(limits)
    assert limits[0] == pytest.approx(1.0, abs=1e-2)
    # 1 + e z² with z normal: the quantile by its definition, against Satterthwaite's.
    exact = np.sqrt(1.0 + 2.0 * scipy.stats.norm.isf(0.005) ** 2)
    assert limits[2] == pytest.approx(exact, rel=0.1)
