import numpy as np
import pytest
from linearmodels.iv import IV2SLS

from idim_iv_ros.estimation.qr import r_factor
from idim_iv_ros.statistics.instruments import exogeneity_f_test, exogeneity_test
from tests.statistics.worlds import joint_rows


def matrices(seed, n_rows=600, n_columns=6, endogeneity=0.4):
    rng = np.random.default_rng(seed)
    z = rng.standard_normal((n_rows, n_columns)) * 10.0 ** rng.integers(-3, 3, n_columns)
    v = 0.3 * rng.standard_normal(z.shape) * z.std(axis=0)
    v[:, :2] = 0.0
    x = z + v
    y = (x / z.std(axis=0)).sum(axis=1) + rng.standard_normal(n_rows)
    return x, z, y + endogeneity * v[:, 2] / z[:, 2].std()


def reduced(x, z, y):
    return r_factor(np.column_stack([z, x, y]))


@pytest.mark.parametrize("seed", range(5))
def test_statistic_is_the_wu_hausman_of_linearmodels(seed):
    x, z, y = matrices(seed)
    test = exogeneity_f_test(reduced(x, z, y), len(y), "all")
    oracle = IV2SLS(y, x[:, :2], x[:, 2:], z[:, 2:]).fit(cov_type="unadjusted").wu_hausman()
    assert test.statistic == pytest.approx(oracle.stat, rel=1e-8)
    assert test.p_value == pytest.approx(oracle.pval, rel=1e-6)
    assert (test.df, test.df_denom) == (oracle.df, oracle.df_denom)


def test_a_regressor_that_the_instruments_reproduce_is_exogenous_without_a_test():
    _, z, y = matrices(1)
    test = exogeneity_f_test(reduced(z, z, y), len(y), "all")
    assert test.accepted is None
    assert "exogenous" in test.reason


def test_collinear_columns_are_dropped_and_counted_once():
    x, z, y = matrices(2)
    twice = np.hstack([np.arange(6), [3]])
    test = exogeneity_f_test(reduced(x[:, twice], z[:, twice], y), len(y), "all")
    once = exogeneity_f_test(reduced(x, z, y), len(y), "all")
    assert test.df == once.df
    assert test.statistic == pytest.approx(once.statistic, rel=1e-6)


def test_too_few_rows_and_no_residual_are_values_with_a_reason():
    x, z, y = matrices(3, n_rows=9)
    assert "9 rows" in exogeneity_f_test(reduced(x, z, y), 9, "all").reason
    x, z, _ = matrices(3)
    exact = exogeneity_f_test(reduced(x, z, x @ np.ones(6)), 600, "all")
    assert "vanishes" in exact.reason


def test_the_joint_whose_noise_enters_the_torque_is_the_one_rejected():
    clean, noisy = matrices(4, endogeneity=0.0), matrices(5, endogeneity=2.0)
    joints = [
        joint_rows(name, x, z, y, np.arange(6) + first, [slice(0, 250), slice(250, 600)])
        for name, (x, z, y), first in (("clean", clean, 0), ("noisy", noisy, 6))
    ]
    parameters = np.concatenate([np.linalg.solve(z.T @ x, z.T @ y) for x, z, y in (clean, noisy)])
    everything, first, second = exogeneity_test(joints, parameters)
    assert [everything.scope, first.scope, second.scope] == ["all", "clean", "noisy"]
    assert first.accepted
    assert second.accepted is False
    assert everything.accepted is False
    assert everything.df == 8
