"""Whitening by autoregressions: against dense formulas and statsmodels."""

import numpy as np
import pytest
from scipy.linalg import toeplitz
from scipy.signal import cheby1, lfilter, sosfiltfilt
from statsmodels.regression.linear_model import burg

from idim_iv_ros.signals.autoregression import AutoregressiveModel, fit_autoregression

AR4 = [-2.7607, 3.8106, -2.6535, 0.9238]  # the textbook AR(4) with two sharp resonances


def autocorrelated(seed, coefficients, n_rows, n_columns=None):
    shape = n_rows + 1000 if n_columns is None else (n_rows + 1000, n_columns)
    noise = np.random.default_rng(seed).standard_normal(shape)
    return lfilter([1.0], [1.0, *coefficients], noise, axis=0)[1000:]


def whole(series):
    return [slice(0, len(series))]


def covariance_of(model, n_rows):
    """Covariance of a run that the whitening implies, σ² L⁻¹ L⁻ᵀ."""
    inverse = np.linalg.inv(model.whiten(np.eye(n_rows), [slice(0, n_rows)]))
    return model.innovation_variance * inverse @ inverse.T


@pytest.mark.parametrize("order", [1, 4, 12])
def test_coefficients_are_those_of_statsmodels_burg(order):
    series = autocorrelated(0, AR4, 1500)
    model = fit_autoregression(series, whole(series), max_order=order)
    expected, _ = burg(series, model.order, demean=False)
    np.testing.assert_allclose(model.coefficients, -expected, rtol=1e-10, atol=1e-12)


def test_whitening_implies_a_stationary_covariance_of_the_stated_variance():
    model = fit_autoregression(autocorrelated(5, AR4, 3000), [slice(0, 3000)], max_order=8)
    covariance = covariance_of(model, 60)
    np.testing.assert_allclose(covariance, toeplitz(covariance[0]), atol=1e-8 * model.variance)
    assert covariance[0, 0] == pytest.approx(model.variance)


def test_each_run_is_whitened_as_if_it_were_alone():
    model = fit_autoregression(autocorrelated(6, AR4, 3000), [slice(0, 3000)], max_order=4)
    rows = np.random.default_rng(7).standard_normal((50, 3))
    segments = [slice(0, 2), slice(2, 30), slice(30, 31), slice(31, 50)]
    expected = np.vstack([model.whiten(rows[run], whole(rows[run])) for run in segments])
    np.testing.assert_allclose(model.whiten(rows, segments), expected)
    np.testing.assert_allclose(model.whiten(rows[:, 0], segments), expected[:, 0])


def test_a_break_between_runs_is_not_taken_for_a_sample():
    pieces = [autocorrelated(seed, [-0.95], 40) for seed in range(200)]
    segments = [slice(40 * i, 40 * i + 40) for i in range(200)]
    series = np.concatenate(pieces)
    model = fit_autoregression(series, segments, max_order=1)
    ignoring = fit_autoregression(series, whole(series), max_order=1)
    assert model.coefficients[0] == pytest.approx(-0.95, abs=0.01)
    assert abs(ignoring.coefficients[0] + 0.95) > 2 * abs(model.coefficients[0] + 0.95)


def test_oversampled_residual_with_80_db_of_dynamic_range_is_whitened_stably():
    rng = np.random.default_rng(9)
    low = sosfiltfilt(cheby1(8, 0.05, 0.1, output="sos"), rng.standard_normal(30_000))
    series = low + 1e-4 * low.std() * rng.standard_normal(30_000)
    model = fit_autoregression(series, whole(series))
    assert np.abs(np.roots(np.append(1.0, model.coefficients))).max() < 1.0
    white = model.whiten(series, whole(series))
    assert model.predictable_share > 1.0 - 1e-4
    assert np.abs(np.corrcoef(white[1:], white[:-1])[0, 1]) < 0.02
    assert white.var() == pytest.approx(model.innovation_variance, rel=1e-3)
    back = model.shaping_adjoint(np.eye(300, 2), np.arange(300))
    covariance = model.innovation_variance * back.T @ back
    np.testing.assert_allclose(np.diag(covariance), model.variance, rtol=1e-6)


def test_adjoint_gives_the_covariance_of_sums_over_rows_with_gaps():
    model = fit_autoregression(autocorrelated(10, AR4, 3000), [slice(0, 3000)], max_order=6)
    rows = np.random.default_rng(11).standard_normal((70, 3))
    positions = np.r_[0:30, 41:61, 80:100]
    covariance = covariance_of(model, 100)[np.ix_(positions, positions)]
    spread = model.shaping_adjoint(rows, positions)
    actual = model.innovation_variance * spread.T @ spread
    expected = rows.T @ covariance @ rows
    np.testing.assert_allclose(actual, expected, rtol=1e-8, atol=1e-8 * np.abs(expected).max())


@pytest.mark.parametrize("length", [1, 5, 6, 7])
def test_runs_no_longer_than_the_order_are_autocorrelated_exactly(length):
    model = AutoregressiveModel(np.array([-0.9, 0.5, 0.3, -0.2, 0.1, 0.4]), 2.0)
    spread = model.shaping_adjoint(np.eye(length), np.arange(length))
    actual = model.innovation_variance * spread.T @ spread
    np.testing.assert_allclose(actual, covariance_of(model, length), rtol=1e-10)


def test_recordings_far_apart_are_independent_and_cost_no_memory():
    model = AutoregressiveModel(np.array([-0.9]), 1.0)
    rows = np.random.default_rng(12).standard_normal((40, 2))
    positions = np.r_[0:20, 10**9 : 10**9 + 20]
    spread = model.shaping_adjoint(rows, positions)
    alone = [model.shaping_adjoint(part, np.arange(20)) for part in (rows[:20], rows[20:])]
    np.testing.assert_allclose(spread, np.vstack(alone))


def test_white_noise_raises_the_density_everywhere_by_its_share():
    """Predictors against Yule-Walker of the covariance, which the impulse response gives."""
    model = fit_autoregression(autocorrelated(9, AR4, 5000), [slice(0, 5000)], max_order=4)
    response = lfilter([1.0], [1.0, *model.coefficients], np.eye(1, 4000)[0])
    covariance = model.innovation_variance * np.array(
        [response[: 4000 - lag] @ response[lag:] for lag in range(5)]
    )
    covariance[0] *= 1.01
    expected = np.linalg.solve(toeplitz(covariance[:4]), -covariance[1:])
    noisy = model.with_white_noise(0.01)
    np.testing.assert_allclose(noisy.coefficients, expected, rtol=1e-6)
    assert noisy.innovation_variance == pytest.approx(
        covariance[0] + expected @ covariance[1:], rel=1e-6
    )
    assert noisy.variance == pytest.approx(1.01 * model.variance)
    assert model.with_white_noise(0.0).reflections == pytest.approx(model.reflections)


def test_adjoint_gives_the_products_of_whitened_rows():
    """One segment is shorter than the order."""
    model = fit_autoregression(autocorrelated(11, AR4, 400), [slice(0, 400)], max_order=4)
    random = np.random.default_rng(12)
    columns, rows = random.standard_normal((60, 3)), random.standard_normal((60, 2))
    segments = [slice(0, 2), slice(2, 35), slice(35, 60)]
    expected = model.standardized(columns, segments).T @ rows
    drawn = model.standardized_adjoint(rows, segments)
    np.testing.assert_allclose(columns.T @ drawn, expected, rtol=1e-9, atol=1e-12)
