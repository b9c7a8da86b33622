import numpy as np
import pytest
from statsmodels.stats.diagnostic import acorr_ljungbox
from statsmodels.stats.stattools import jarque_bera
from statsmodels.tsa.stattools import acf

from idim_iv_ros.statistics.residuals import autocorrelation, diagnose_residual, ljung_box
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
    rejected = np.mean([not test.accepted for test in tests])
    assert 0.02 < rejected < 0.085


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
