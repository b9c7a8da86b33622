"""Whether the regressor is exogenous and the instruments are valid, joint by joint."""

from dataclasses import replace

import numpy as np
import pytest
from linearmodels.iv import IV2SLS

from idim_iv_ros.estimation.qr import r_factor
from idim_iv_ros.statistics.instruments import (
    exogeneity_f_test,
    exogeneity_test,
    wald_test_of_instruments,
)
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


def test_too_few_rows_and_no_residual_are_values_with_a_reason():
    x, z, y = matrices(3, n_rows=9)
    assert "9 rows" in exogeneity_f_test(reduced(x, z, y), 9, "all").reason
    x, z, _ = matrices(3)
    assert "vanishes" in exogeneity_f_test(reduced(x, z, x @ np.ones(6)), 600, "all").reason


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


def white_joint(seed, n_rows=800, n_columns=4, factor=1.0, joint="joint", first=0):
    """X = factor · Z + V with everything white, and β̂ = 1."""
    rng = np.random.default_rng(seed)
    z = rng.standard_normal((n_rows, n_columns))
    x = factor * z + 0.1 * rng.standard_normal(z.shape)
    columns = np.arange(n_columns) + first
    return joint_rows(joint, x, z, x.sum(axis=1), columns, [slice(0, n_rows)])


def with_columns(rows, chosen, places):
    """The rows with some of their columns, at other places among the parameters."""
    chosen = np.asarray(chosen, dtype=int)
    matrix, instruments = rows.matrix[:, chosen], rows.instruments[:, chosen]
    return replace(rows, matrix=matrix, instrument_matrix=instruments, columns=places)


def test_statistic_on_white_rows_is_the_textbook_f():
    import statsmodels.api as sm

    rows = white_joint(1)
    test = wald_test_of_instruments([rows], np.ones(4))[1]
    oracle = sm.OLS(rows.matrix.sum(axis=1), rows.instruments).fit().f_test((np.eye(4), np.ones(4)))
    assert test.statistic == pytest.approx(float(oracle.fvalue), rel=1e-9)
    assert test.p_value == pytest.approx(float(oracle.pvalue), rel=1e-6)
    assert (test.df, test.df_denom) == (4, 796)


def test_a_deviation_of_three_percent_is_found_with_its_size():
    everything, joint = wald_test_of_instruments([white_joint(2, factor=1.03)], np.ones(4))
    assert joint.accepted is False
    assert joint.torque_deviation_percent == pytest.approx(100 * 0.03 / 1.03, abs=0.5)
    assert joint.max_deviation == pytest.approx(0.03, abs=0.01)
    assert everything.accepted is False


def test_the_wrong_joint_is_named_and_the_right_one_is_not():
    joints = [white_joint(3, joint="right"), white_joint(4, factor=1.05, joint="wrong", first=4)]
    everything, right, wrong = wald_test_of_instruments(joints, np.ones(8))
    assert [t.scope for t in (everything, right, wrong)] == ["all", "right", "wrong"]
    assert everything.accepted is False
    assert right.accepted
    assert wrong.accepted is False
    assert right.torque_deviation_percent < 1.0 < wrong.torque_deviation_percent


def test_units_of_the_columns_change_neither_statistic_nor_effect_size():
    rows = white_joint(5, factor=1.02)
    units = np.array([1e-5, 1.0, 1e5, 1e-2])
    scaled = replace(rows, matrix=rows.matrix * units, instrument_matrix=rows.instruments * units)
    plain = wald_test_of_instruments([rows], np.ones(4))[1]
    other = wald_test_of_instruments([scaled], 1.0 / units)[1]
    assert other.statistic == pytest.approx(plain.statistic, rel=1e-8)
    assert other.max_deviation == pytest.approx(plain.max_deviation, rel=1e-8)
    assert other.torque_deviation_percent == pytest.approx(plain.torque_deviation_percent)


def test_columns_that_one_joint_cannot_tell_apart_are_one_restriction():
    rows = white_joint(6)
    wide = with_columns(rows, [0, 1, 2, 3, 3], np.arange(5))
    narrow = wald_test_of_instruments([rows], np.ones(4))[1]
    test = wald_test_of_instruments([wide], np.array([1.0, 1.0, 1.0, 0.5, 0.5]))[1]
    assert test.df == narrow.df == 4
    assert test.statistic == pytest.approx(narrow.statistic, rel=1e-6)


def test_what_cannot_be_tested_is_a_value_with_a_reason():
    rows = white_joint(8)
    same = replace(rows, matrix=rows.instruments)
    assert "equal the regressor" in wald_test_of_instruments([same], np.ones(4))[1].reason
    few = white_joint(9, n_rows=12)
    assert "12 rows" in wald_test_of_instruments([few], np.ones(4))[1].reason
    assert "no torque" in wald_test_of_instruments([rows], np.zeros(4))[1].reason
    empty = with_columns(rows, [], np.zeros(0, int))
    assert "no parameter" in wald_test_of_instruments([empty], np.ones(4))[0].reason
    assert wald_test_of_instruments([], np.ones(4))[0].accepted is None
