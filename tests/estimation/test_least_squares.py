"""Linear estimators on made-up regressions with a known answer."""

import numpy as np
import pytest
import statsmodels.api as sm

from idim_iv_ros.errors import DataError
from idim_iv_ros.estimation.least_squares import (
    condition_number,
    essential_parameters,
    restrict,
    solve_instrumental_variables,
    solve_least_squares,
    unseen_parameters,
    white_covariance,
)
from idim_iv_ros.estimation.rows import JointRows, with_instruments

TRUTH = np.array([2.0, -1.0, 0.5])


def rows(noise=(0.1, 2.0), samples=400, seed=0) -> list[JointRows]:
    """Joint 1 sees parameters 0 and 1, joint 2 sees 1 and 2; joint 2 is noisier."""
    random = np.random.default_rng(seed)
    of_joints = []
    for joint, columns in enumerate(([0, 1], [1, 2])):
        matrix = random.normal(size=(samples, 2))
        torque = matrix @ TRUTH[columns] + noise[joint] * random.normal(size=samples)
        of_joints.append(JointRows(matrix, torque, np.array(columns), (slice(0, samples),)))
    return of_joints


def dense(of_joints: list[JointRows]) -> tuple[np.ndarray, np.ndarray]:
    blocks = []
    for joint in of_joints:
        block = np.zeros((len(joint), 3))
        block[:, joint.columns] = joint.matrix
        blocks.append(block)
    return np.vstack(blocks), np.concatenate([joint.torque for joint in of_joints])


def test_ordinary_least_squares_is_that_of_statsmodels() -> None:
    of_joints = rows()
    matrix, torque = dense(of_joints)
    expected = sm.OLS(torque, matrix).fit().params
    np.testing.assert_allclose(solve_least_squares(of_joints, 3, weighted=False).values, expected)


def test_weighted_least_squares_is_that_of_statsmodels_with_the_same_weights() -> None:
    of_joints = rows()
    matrix, torque = dense(of_joints)
    estimate = solve_least_squares(of_joints, 3)
    sigma = np.repeat(estimate.sigma, 400)
    reference = sm.WLS(torque, matrix, weights=1.0 / sigma**2).fit(cov_type="fixed scale")
    np.testing.assert_allclose(estimate.values, reference.params, rtol=1e-4)
    covariance = white_covariance(of_joints, estimate.sigma, 3)
    np.testing.assert_allclose(covariance, reference.normalized_cov_params, rtol=1e-6)


def test_instruments_remove_the_bias_of_noisy_regressors() -> None:
    random = np.random.default_rng(5)
    samples = 20_000
    clean = random.normal(size=(samples, 2))
    noisy = clean + 0.5 * random.normal(size=(samples, 2))
    torque = clean @ TRUTH[:2] + 0.1 * random.normal(size=samples)
    of_joints = [JointRows(noisy, torque, np.arange(2), (slice(0, samples),))]
    biased = solve_least_squares(of_joints, 2, weighted=False).values
    estimate = solve_instrumental_variables(with_instruments(of_joints, [clean]), 2, np.ones(1))
    assert np.all(np.abs(biased) < 0.85 * np.abs(TRUTH[:2]))  # attenuation 1 / 1.25
    np.testing.assert_allclose(estimate.values, TRUTH[:2], atol=0.05)


def test_dependent_columns_are_named_not_solved() -> None:
    of_joints = rows()
    of_joints[1].matrix[:, 1] = 0.0
    assert unseen_parameters(of_joints, 3) == [2]
    assert condition_number(rows(), 3) < 3.0


def test_fewer_rows_than_parameters_are_refused() -> None:
    with pytest.raises(DataError, match="cannot determine 3 parameters"):
        solve_least_squares(rows(samples=1), 3)


def regression(seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    random = np.random.default_rng(seed)
    matrix = random.normal(size=(300, 6)) @ (np.eye(6) + 0.1 * random.normal(size=(6, 6)))
    truth = np.array([3.0, 0.0, -2.0, 0.0, 1.0, 0.0])
    return matrix, matrix @ truth + random.normal(size=300)


def test_f_statistic_is_that_of_nested_models() -> None:
    matrix, torque = regression()
    full = sm.OLS(torque, matrix).fit()
    essential = essential_parameters(full.params, full.cov_params(), len(torque))
    nested = sm.OLS(torque, matrix[:, essential.columns]).fit()
    statistic, p_value, _ = full.compare_f_test(nested)
    np.testing.assert_allclose(
        [essential.statistic, essential.p_value], [statistic, p_value], rtol=1e-8
    )
    restricted, _ = restrict(full.params, full.cov_params(), essential.columns.tolist())
    np.testing.assert_allclose(restricted, nested.params, rtol=1e-8)


def test_parameters_that_are_zero_are_left_out_and_the_others_stay() -> None:
    kept = []
    for seed in range(40):
        matrix, torque = regression(seed)
        full = sm.OLS(torque, matrix).fit()
        essential = essential_parameters(full.params, full.cov_params(), len(torque))
        kept.append(set(essential.columns.tolist()))
    assert all({0, 2, 4} <= columns for columns in kept)
    superfluous = np.mean([len(columns - {0, 2, 4}) > 0 for columns in kept])
    assert superfluous < 0.2
