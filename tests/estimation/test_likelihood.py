"""Generalised least squares against dense algebra with the covariance written out."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import block_diag, toeplitz
from scipy.signal import lfilter

from idim_iv_ros.diagnosis.comparison.ledger import RowNoise, scale_of
from idim_iv_ros.diagnosis.identifiability import Absorption
from idim_iv_ros.estimation.likelihood import Regression
from idim_iv_ros.estimation.rows import JointRows
from idim_iv_ros.signals.autoregression import AutoregressiveModel

VALUES = np.array([1.5, -0.7, 0.4])


def autoregressive(pole: float, sigma: float) -> AutoregressiveModel:
    """x_t = pole · x_{t−1} + e_t, e_t of standard deviation `sigma`."""
    return AutoregressiveModel(np.array([-pole]), sigma**2)


def white(sigma: float) -> AutoregressiveModel:
    """White noise of a standard deviation."""
    return AutoregressiveModel(np.zeros(0), sigma**2)


def world(
    seed: int, rows: int = 400, pole: float = 0.0, sigma: float = 0.3, joints: int = 2
) -> Regression:
    """Two joints that share a parameter: joint 0 has columns 0 and 1, joint 1 has 1 and 2."""
    random = np.random.default_rng(seed)
    made = []
    for joint in range(joints):
        matrix = random.standard_normal((rows, 2))
        noise = lfilter([1.0], [1.0, -pole], sigma * random.standard_normal(rows))
        columns = np.array([0, 1]) + joint
        segments = (slice(0, rows // 3), slice(rows // 3, rows))
        made.append(JointRows(matrix, matrix @ VALUES[columns] + noise, columns, segments))
    return Regression(tuple(made), 3 if joints == 2 else 2)


def test_estimate_and_covariance_are_those_of_the_dense_solution() -> None:
    poles, sigmas = (0.8, -0.5), (0.2, 0.7)
    extra = np.random.default_rng(9).standard_normal((400, 2))
    regression = world(1, pole=0.8).with_columns({1: extra})
    noise_models = [autoregressive(pole, sigma) for pole, sigma in zip(poles, sigmas, strict=True)]
    fit = regression.fit(noise_models, steps=0)
    wide, inverses, torque = [], [], []
    for joint, (pole, sigma) in enumerate(zip(poles, sigmas, strict=True)):
        data = regression.joints[joint]
        matrix = np.zeros((400, 5))
        matrix[:, data.columns] = data.matrix
        if joint == 1:
            matrix[:, 3:] = extra
        wide.append(matrix)
        torque.append(data.torque)
        lengths = [run.stop - run.start for run in data.segments]
        blocks = [toeplitz(sigma**2 * pole ** np.arange(n) / (1.0 - pole**2)) for n in lengths]
        inverses.append(np.linalg.inv(block_diag(*blocks)))
    x, y, weight = np.vstack(wide), np.concatenate(torque), block_diag(*inverses)
    covariance = np.linalg.inv(x.T @ weight @ x)
    expected = covariance @ x.T @ weight @ y
    np.testing.assert_allclose(np.r_[fit.values, fit.coefficients], expected, rtol=1e-6, atol=1e-8)
    np.testing.assert_allclose(fit.covariance, covariance, rtol=1e-6, atol=1e-11)
    np.testing.assert_array_equal(fit.coefficient_covariance, fit.covariance[3:, 3:])
    np.testing.assert_allclose(np.concatenate(fit.residuals), y - x @ expected, atol=1e-7)


def test_autocorrelation_of_the_noise_is_found() -> None:
    fit = world(3, rows=4000, pole=0.9, sigma=0.25).fit()
    for noise in fit.noise_models:
        assert noise.coefficients[0] == pytest.approx(-0.9, abs=0.06)
        assert noise.sigma == pytest.approx(0.25, rel=0.05)


def test_log_likelihood_of_white_noise_is_that_of_its_variance() -> None:
    regression = world(4, joints=1)
    fit = regression.fit([white(0.3)], steps=0)
    residual = fit.residuals[0]
    expected = -0.5 * len(residual) * np.log(residual @ residual / len(residual))
    assert fit.log_likelihood == pytest.approx(expected, rel=1e-12)


def test_a_autocorrelation_pays_one_for_each_of_its_coefficients() -> None:
    regression = world(4, joints=1)
    plain = regression.fit([white(0.3)], steps=0)
    zeros = AutoregressiveModel(np.zeros(3), 0.09)
    paid = regression.fit([zeros], steps=0)
    assert plain.log_likelihood - paid.log_likelihood == pytest.approx(3.0)


def test_a_true_column_gains_what_it_explains_and_noise_gains_half_on_average() -> None:
    """Gain −n/2 ln(1 − R²) for the one, E[χ²₁]/2 for the other."""
    random = np.random.default_rng(5)
    gains = []
    for seed in range(150):
        regression = world(seed, joints=1)
        start = [white(0.3)]
        fit = regression.fit(start, steps=0)
        noise = regression.with_columns({0: random.standard_normal((400, 1))})
        gains.append(noise.fit(start, steps=0).log_likelihood - fit.log_likelihood)
    # χ²₁ / 2 has a variance of one half.
    assert np.mean(gains) == pytest.approx(0.5, abs=4.0 * np.sqrt(0.5 / len(gains)))
    column = random.standard_normal((400, 1))
    data = regression.joints[0]
    data = replace(data, torque=data.torque + 0.3 * column[:, 0])
    moved = Regression((data,), 2)
    before = moved.fit(start, steps=0)
    after = moved.with_columns({0: column}).fit(start, steps=0)
    gain = after.log_likelihood - before.log_likelihood
    energies = [
        np.linalg.lstsq(columns, data.torque, rcond=None)[1][0]
        for columns in (data.matrix, np.hstack([data.matrix, column]))
    ]
    assert energies[1] < 0.6 * energies[0]  # about half of the energy goes
    assert gain == pytest.approx(200.0 * np.log(energies[0] / energies[1]), rel=1e-9)


def test_what_the_model_absorbs_of_columns_is_what_dense_least_squares_takes() -> None:
    regression = world(6, pole=0.8)
    noise_models = [autoregressive(0.8, 0.3)] * 2
    random = np.random.default_rng(7)
    of_first = regression.joints[0].matrix[:, [0]]  # parameter 0 moves joint 0 alone
    both = {0: np.hstack([of_first, random.standard_normal((400, 1))]), 1: np.zeros((400, 2))}
    both[1][:, 1] = random.standard_normal(400)
    energy, left = Absorption(regression, noise_models).left(both)
    model, columns = np.zeros((800, 3)), np.zeros((800, 2))
    for joint, (rows, noise) in enumerate(zip(regression.joints, noise_models, strict=True)):
        here = slice(400 * joint, 400 * (joint + 1))
        model[here, rows.columns] = noise.standardized(rows.matrix, rows.segments)
        columns[here] = noise.standardized(both[joint], rows.segments)
    rest = columns - model @ np.linalg.lstsq(model, columns, rcond=None)[0]
    np.testing.assert_allclose(energy, np.sum(columns**2, axis=0), rtol=1e-12)
    np.testing.assert_allclose(left, np.sum(rest**2, axis=0), atol=1e-9 * energy.max())
    assert left[0] < 1e-9 * energy[0] < left[1]


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
