import numpy as np
import pytest
from linearmodels.iv import IV2SLS
from scipy.signal import lfilter

from idim_iv_ros.estimation.covariance import (
    AutocorrelatedBlock,
    AutocorrelatedCovariance,
    JointBlock,
    RefinedCovariance,
    WhiteCovariance,
)
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


def stacked(parts, columns, weights):
    wide = np.zeros((sum(map(len, parts)), B))
    row = 0
    for part, places, weight in zip(parts, columns, weights, strict=True):
        wide[row : row + len(part), places] = part * weight
        row += len(part)
    return wide


def test_white_covariance_is_the_formula_on_the_stacked_weighted_rows(two_joints):
    columns, instruments, regressors = two_joints
    sigmas = (0.5, 4.0)
    blocks = [
        JointBlock(x, z, places, sigma)
        for x, z, places, sigma in zip(regressors, instruments, columns, sigmas, strict=True)
    ]
    z = stacked(instruments, columns, [1 / s for s in sigmas])
    x = stacked(regressors, columns, [1 / s for s in sigmas])
    bread = np.linalg.inv(z.T @ x)
    np.testing.assert_allclose(WhiteCovariance(blocks, B).matrix, bread @ z.T @ z @ bread.T)
    np.testing.assert_allclose(RefinedCovariance(blocks, B).matrix, np.linalg.inv(z.T @ z))


def test_white_covariance_equals_that_of_linearmodels():
    rng = np.random.default_rng(1)
    z = rng.standard_normal((400, B))
    x = z + 0.5 * rng.standard_normal((400, B))
    y = x @ np.ones(B) + rng.standard_normal(400)
    oracle = IV2SLS(y, None, x, z).fit(cov_type="unadjusted")
    sigma = float(np.sqrt(oracle.s2))
    actual = WhiteCovariance([JointBlock(x, z, np.arange(B), sigma)], B).matrix
    np.testing.assert_allclose(actual, np.asarray(oracle.cov), rtol=1e-9, atol=1e-15)


def test_a_white_residual_makes_the_sandwich_the_white_covariance(two_joints):
    columns, instruments, regressors = two_joints
    white, coloured = [], []
    for x, z, places, sigma in zip(regressors, instruments, columns, (0.5, 4.0), strict=True):
        white.append(JointBlock(x, z, places, sigma))
        model = AutoregressiveModel(np.zeros(0), sigma**2)
        coloured.append(AutocorrelatedBlock(x, z, places, sigma, model, np.arange(len(x))))
    np.testing.assert_allclose(
        AutocorrelatedCovariance(coloured, B).matrix, WhiteCovariance(white, B).matrix
    )


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
    sigma = np.sqrt(model.variance)
    coloured = AutocorrelatedCovariance(
        [AutocorrelatedBlock(x, z, np.arange(B), sigma, model, positions)], B
    )
    white = WhiteCovariance([JointBlock(x, z, np.arange(B), sigma)], B)
    np.testing.assert_allclose(np.sqrt(np.diag(coloured.matrix)), scatter, rtol=0.05)
    assert np.all(np.sqrt(np.diag(white.matrix)) < scatter / 2)


def test_undetermined_parameters_are_refused():
    z = np.ones((50, 2))
    with pytest.raises(np.linalg.LinAlgError):
        _ = WhiteCovariance([JointBlock(z, z, np.arange(2), 1.0)], 2).matrix
    with pytest.raises(np.linalg.LinAlgError):
        _ = WhiteCovariance([JointBlock(z[:1], z[:1], np.arange(2), 1.0)], 2).matrix
