"""R factors one below the other against one regression of all rows."""

import numpy as np
import pytest
import statsmodels.api as sm

from idim_iv_ros.estimation.qr import r_factor
from idim_iv_ros.fleet.regression import stacked
from idim_iv_ros.fleet.statistics.quantities import regression, shares

BAGS, ROWS, WIDTH = 5, 60, 4


def recorded(differing: float) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """X and y of each bag; friction of the last bag differs."""
    random = np.random.default_rng(2)
    matrices = [random.normal(size=(ROWS, WIDTH)) * [1.0, 10.0, 0.1, 1.0] for _ in range(BAGS)]
    torques = []
    for bag, matrix in enumerate(matrices):
        true = np.array([1.0, 2.0, 3.0, 4.0 + differing * (bag == BAGS - 1)])
        torques.append(matrix @ true + random.normal(size=ROWS))
    return matrices, torques


def factors_of(matrices: list[np.ndarray], torques: list[np.ndarray]) -> list[np.ndarray]:
    pairs = zip(matrices, torques, strict=True)
    return [r_factor(np.column_stack([matrix, torque])) for matrix, torque in pairs]


def test_stacked_factors_give_the_answer_of_all_rows() -> None:
    matrices, torques = recorded(0.0)
    whole = sm.OLS(np.concatenate(torques), np.vstack(matrices)).fit()
    pooled = regression(stacked(factors_of(matrices, torques)), BAGS * ROWS)
    assert pooled.complete
    np.testing.assert_allclose(pooled.values, whole.params, rtol=1e-10)
    np.testing.assert_allclose(pooled.covariance, whole.cov_params(), rtol=1e-10, atol=1e-14)
    assert pooled.squares == pytest.approx(whole.ssr, rel=1e-10)


def test_the_estimate_of_all_is_the_weighted_sum_of_those_of_the_bags() -> None:
    matrices, torques = recorded(2.0)
    factors = factors_of(matrices, torques)
    parts = [regression(factor, ROWS).values for factor in factors]
    joined = sum(share @ part for share, part in zip(shares(factors), parts, strict=True))
    np.testing.assert_allclose(joined, regression(stacked(factors), BAGS * ROWS).values)


def test_a_bag_that_does_not_show_every_parameter_is_not_complete() -> None:
    matrices, torques = recorded(0.0)
    matrices[0][:, 2] = 2.0 * matrices[0][:, 1]
    factors = factors_of(matrices, torques)
    assert not regression(factors[0], ROWS).complete
    whole = sm.OLS(np.concatenate(torques), np.vstack(matrices)).fit()
    pooled = regression(stacked(factors), BAGS * ROWS)
    np.testing.assert_allclose(pooled.values, whole.params, rtol=1e-10)
