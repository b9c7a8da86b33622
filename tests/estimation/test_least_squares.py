"""Linear estimators on made-up regressions with a known answer."""

from dataclasses import replace

import numpy as np
import pytest
import statsmodels.api as sm
from linearmodels.iv import IV2SLS
from scipy.signal import lfilter

from idim_iv_ros.errors import DataError
from idim_iv_ros.estimation.least_squares import (
    AutocorrelatedCovariance,
    condition_number,
    essential_parameters,
    refined_covariance,
    restrict,
    solve_instrumental_variables,
    solve_least_squares,
    unseen_parameters,
    white_covariance,
)
from idim_iv_ros.estimation.qr import (
    BLOCK,
    independent_basis,
    r_factor,
    stacked_r_factor,
    streamed_r_factor,
)
from idim_iv_ros.estimation.rows import JointRows, with_instruments
from idim_iv_ros.signals.autoregression import AutoregressiveModel

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
    columns, p_value = essential_parameters(full.params, full.cov_params(), len(torque))
    nested = sm.OLS(torque, matrix[:, columns]).fit()
    np.testing.assert_allclose(p_value, full.compare_f_test(nested)[1], rtol=1e-8)
    restricted, _ = restrict(full.params, full.cov_params(), columns.tolist())
    np.testing.assert_allclose(restricted, nested.params, rtol=1e-8)


def test_parameters_that_are_zero_are_left_out_and_the_others_stay() -> None:
    kept = []
    for seed in range(40):
        matrix, torque = regression(seed)
        full = sm.OLS(torque, matrix).fit()
        columns, _ = essential_parameters(full.params, full.cov_params(), len(torque))
        kept.append(set(columns.tolist()))
    assert all({0, 2, 4} <= columns for columns in kept)
    assert np.mean([len(columns - {0, 2, 4}) > 0 for columns in kept]) < 0.2


B = 5


@pytest.fixture
def two_joints():
    """Slow instruments of two joints that share a parameter, and the regressors."""
    rng = np.random.default_rng(0)
    columns = [np.array([0, 1, 2]), np.array([2, 3, 4])]
    instruments = [np.cumsum(rng.standard_normal((300, 3)), axis=0) for _ in columns]
    regressors = [z + 0.3 * rng.standard_normal(z.shape) for z in instruments]
    return columns, instruments, regressors


def joint(x, z, places, positions=None) -> JointRows:
    """Rows whose torque plays no part."""
    return JointRows(
        x, np.zeros(len(x)), places, position=positions, instrument_matrix=None if z is x else z
    )


def stacked(parts, columns, weights):
    wide = np.zeros((sum(map(len, parts)), B))
    row = 0
    for part, places, weight in zip(parts, columns, weights, strict=True):
        wide[row : row + len(part), places] = part * weight
        row += len(part)
    return wide


def test_white_covariance_is_the_formula_on_the_stacked_weighted_rows(two_joints):
    columns, instruments, regressors = two_joints
    sigmas = np.array([0.5, 4.0])
    rows = [
        joint(x, z, places) for x, z, places in zip(regressors, instruments, columns, strict=True)
    ]
    z = stacked(instruments, columns, [1 / s for s in sigmas])
    x = stacked(regressors, columns, [1 / s for s in sigmas])
    bread = np.linalg.inv(z.T @ x)
    np.testing.assert_allclose(white_covariance(rows, sigmas, B), bread @ z.T @ z @ bread.T)
    np.testing.assert_allclose(refined_covariance(rows, sigmas, B), np.linalg.inv(z.T @ z))


def test_white_covariance_equals_that_of_linearmodels():
    rng = np.random.default_rng(1)
    z = rng.standard_normal((400, B))
    x = z + 0.5 * rng.standard_normal((400, B))
    y = x @ np.ones(B) + rng.standard_normal(400)
    oracle = IV2SLS(y, None, x, z).fit(cov_type="unadjusted")
    sigma = float(np.sqrt(oracle.s2))
    actual = white_covariance([joint(x, z, np.arange(B))], np.array([sigma]), B)
    np.testing.assert_allclose(actual, np.asarray(oracle.cov), rtol=1e-9, atol=1e-15)


def test_sandwich_is_the_scatter_of_the_estimates_where_the_white_one_is_too_small():
    """Slow instruments, AR(1) of 0.9, a quarter of the rows dropped: 3,000 noise seeds."""
    rng = np.random.default_rng(2)
    n_grid = 400
    z = np.cumsum(rng.standard_normal((n_grid, B)), axis=0)
    x = z + 0.1 * rng.standard_normal(z.shape)
    positions = np.sort(rng.permutation(n_grid)[:300])
    z, x = z[positions], x[positions]
    model = AutoregressiveModel(np.array([-0.9]), 1.0)
    noise = lfilter([1.0], [1.0, -0.9], rng.standard_normal((n_grid + 200, 3000)), axis=0)[200:]
    errors = np.linalg.solve(z.T @ x, z.T @ noise[positions])
    scatter = errors.std(axis=1)
    sigma = np.array([np.sqrt(model.variance)])
    rows = [joint(x, z, np.arange(B), positions)]
    sandwich = AutocorrelatedCovariance(rows, sigma, [model], B)
    white = white_covariance(rows, sigma, B)
    np.testing.assert_allclose(np.sqrt(np.diag(sandwich.matrix)), scatter, rtol=0.05)
    assert np.all(np.sqrt(np.diag(white)) < scatter / 2)


def test_undetermined_parameters_are_refused():
    z = np.ones((50, 2))
    for rows in (z, z[:1]):
        with pytest.raises(DataError, match="do not determine all parameters"):
            _ = white_covariance([joint(rows, rows, np.arange(2))], np.ones(1), 2)


def tall(rows: int, columns: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).standard_normal((rows, columns))


@pytest.mark.parametrize("rows", [3, 5, 200, 2 * BLOCK + 17])
def test_r_factor_is_triangular_and_keeps_all_products(rows: int) -> None:
    matrix = tall(rows, 5)
    factor = r_factor(matrix)
    assert factor.shape == (min(rows, 5), 5)
    np.testing.assert_array_equal(factor, np.triu(factor))
    np.testing.assert_allclose(factor.T @ factor, matrix.T @ matrix, rtol=1e-10, atol=1e-9)


def test_blocks_give_the_r_factor_of_all_rows_but_for_signs() -> None:
    matrix = tall(300, 4)
    blocks = (matrix[:7], matrix[7:7], matrix[7:290], matrix[290:])
    streamed = streamed_r_factor(blocks, 4)
    np.testing.assert_allclose(np.abs(streamed), np.abs(r_factor(matrix)), rtol=1e-10)
    assert streamed_r_factor((), 4).shape == (0, 4)


def test_parts_with_some_of_the_columns_stack_as_their_wide_rows() -> None:
    first, second = tall(50, 2, 1), tall(60, 2, 2)
    wide = np.zeros((110, 3))
    wide[:50, [0, 2]], wide[50:, [1, -1]] = first, second
    stacked = stacked_r_factor([first, second], [np.array([0, 2]), np.array([1, -1])], 3)
    np.testing.assert_allclose(stacked.T @ stacked, wide.T @ wide, atol=1e-12)


def test_a_column_that_depends_on_those_before_it_is_dropped_whatever_its_unit() -> None:
    free = tall(40, 3)
    columns = np.column_stack([free[:, 0], 1e9 * free[:, 0], free[:, 1], np.zeros(40), free[:, 2]])
    basis = independent_basis(columns * [1e-12, 1.0, 1.0, 1.0, 1e7])
    assert basis.kept.tolist() == [0, 2, 4]
    target = free @ [2.0, -1.0, 0.5]
    np.testing.assert_allclose(
        basis.solve(target, 5), [2e12, 0.0, -1.0, 0.0, 0.5e-7], rtol=1e-10, atol=1e-20
    )
    np.testing.assert_allclose(basis.remove(target), 0.0, atol=1e-12)


def test_leading_columns_are_solved_as_if_the_others_were_not_there() -> None:
    columns, target = tall(80, 5), tall(80, 1, 9)[:, 0]
    columns[:, 1] = 3.0 * columns[:, 0]
    leading = independent_basis(columns).leading(4)
    expected = np.linalg.lstsq(columns[:, [0, 2, 3]], target, rcond=None)[0]
    np.testing.assert_allclose(leading.solve(target, 5)[[0, 2, 3]], expected)
    root = leading.inverse_root(5)[[0, 2, 3]]
    kept = columns[:, [0, 2, 3]]
    np.testing.assert_allclose(root @ root.T, np.linalg.inv(kept.T @ kept), rtol=1e-10)


def test_columns_that_normal_equations_cannot_tell_apart_are_solved() -> None:
    """Läuchli's matrix: XᵀX is singular in floating point from ε = 1e-8 on."""
    small = 1e-7
    columns = np.vstack([np.ones(3), small * np.eye(3)])
    truth = np.array([1.0, 2.0, 3.0])
    assert np.linalg.cond(columns.T @ columns) > 1e13
    solution = independent_basis(columns).solve(columns @ truth, 3)
    np.testing.assert_allclose(solution, truth, rtol=1e-7)


def test_joined_rows_keep_their_runs_apart() -> None:
    first, second = rows(samples=60)[0], rows(samples=40, seed=1)[0]
    one = replace(first, segments=(slice(0, 25), slice(25, 60)))
    both = one.joined([replace(second, segments=(slice(0, 40),), left_out=True)])
    assert both.segments == (slice(0, 25), slice(25, 60), slice(60, 100))
    assert (len(both), both.left_out) == (100, True)
    np.testing.assert_array_equal(both.torque, np.append(first.torque, second.torque))
