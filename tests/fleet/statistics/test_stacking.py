"""R factors one below the other against one regression of all rows."""

import numpy as np
import pytest
import statsmodels.api as sm
from scipy import stats

from idim_iv_ros.estimation.qr import r_factor
from idim_iv_ros.fleet.regression import stacked
from idim_iv_ros.fleet.statistics.quantities import agreement, regression, shares

BAGS, ROWS, WIDTH = 5, 60, 4
GROUPS = ([0, 1, 2, 3], [1, 3], [0, 2])  # all columns, friction, the rest


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


@pytest.mark.parametrize("differing", [0.0, 2.0])
def test_agreement_is_the_f_test_with_columns_of_each_bag(differing: float) -> None:
    matrices, torques = recorded(differing)
    p_values = agreement(factors_of(matrices, torques), [ROWS] * BAGS, GROUPS)
    target, common = np.concatenate(torques), np.vstack(matrices)

    def with_own(columns: list[int]) -> np.ndarray:
        blocks = np.zeros((BAGS * ROWS, BAGS * len(columns)))
        for bag, matrix in enumerate(matrices):
            rows = slice(bag * ROWS, (bag + 1) * ROWS)
            blocks[rows, bag * len(columns) : (bag + 1) * len(columns)] = matrix[:, columns]
        others = [k for k in range(WIDTH) if k not in columns]
        return np.hstack([common[:, others], blocks])

    pooled = sm.OLS(target, common).fit()
    every = sm.OLS(target, with_own(list(range(WIDTH)))).fit()
    for p_value, columns in zip(p_values, GROUPS, strict=True):
        free = sm.OLS(target, with_own(columns)).fit()
        extra = (BAGS - 1) * len(columns)
        statistic = (pooled.ssr - free.ssr) / extra / (every.ssr / every.df_resid)
        assert p_value == pytest.approx(stats.f.sf(statistic, extra, every.df_resid), rel=1e-6)
    assert [p_value > 0.025 for p_value in p_values] == [differing == 0.0] * 2 + [True]


def test_one_bag_is_not_tested() -> None:
    matrices, torques = recorded(0.0)
    assert np.isnan(agreement(factors_of(matrices, torques)[:1], [ROWS], GROUPS)).all()


def test_a_bag_that_does_not_show_every_parameter_is_not_complete() -> None:
    matrices, torques = recorded(0.0)
    matrices[0][:, 2] = 2.0 * matrices[0][:, 1]
    factors = factors_of(matrices, torques)
    assert not regression(factors[0], ROWS).complete
    whole = sm.OLS(np.concatenate(torques), np.vstack(matrices)).fit()
    pooled = regression(stacked(factors), BAGS * ROWS)
    np.testing.assert_allclose(pooled.values, whole.params, rtol=1e-10)
