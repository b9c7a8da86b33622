"""Backward elimination: its F equals that of two nested regressions."""

import numpy as np
import statsmodels.api as sm

from idim_iv_ros.estimation.least_squares import essential_parameters, restrict


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
