import numpy as np
import pytest
from linearmodels.iv import IV2SLS
from scipy.signal import lfilter

from idim_iv_ros.errors import DataError
from idim_iv_ros.estimation.least_squares import (
    AutocorrelatedCovariance,
    refined_covariance,
    white_covariance,
)
from idim_iv_ros.estimation.rows import JointRows
from idim_iv_ros.signals.autoregression import AutoregressiveModel

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
