"""Size and power of the tests under autocorrelated errors; the nominal size is 5 %."""

import numpy as np
import pytest
from scipy.stats import f as fisher

from idim_iv_ros.estimation.qr import r_factor
from idim_iv_ros.statistics.instruments import (
    exogeneity_f_test,
    exogeneity_test,
    wald_test_of_instruments,
)
from tests.statistics.worlds import autocorrelated_world, pendulums

AR1, AR1_SLOW, AR2 = [-0.8], [-0.95], [-1.5, 0.7]
AUTOCORRELATIONS = [([], []), (AR1, []), (AR1, AR1), (AR1_SLOW, AR1), (AR2, AR2)]
QUICK, FULL = 150, 1000


def rejections(test, worlds):
    return float(np.mean([test(rows, estimate) < 0.05 for rows, estimate in worlds]))


def worlds(count, residual_noise_model, error_model, **options):
    for seed in range(count):
        yield autocorrelated_world(
            np.random.default_rng(seed), residual_noise_model, error_model, **options
        )


def wald(rows, estimate):
    return wald_test_of_instruments([rows], estimate)[1].p_value


def exogeneity(rows, estimate):
    return exogeneity_test([rows], estimate)[1].p_value


def wald_without_whitening(rows, estimate):
    z = rows.instruments
    difference = (rows.matrix - z) @ estimate
    q, _ = np.linalg.qr(z)
    explained = q.T @ difference
    rest = difference - q @ explained
    c, dof = z.shape[1], len(z) - z.shape[1]
    return fisher.sf((explained @ explained / c) / (rest @ rest / dof), c, dof)


def exogeneity_without_whitening(rows, estimate):
    raw = r_factor(np.column_stack([rows.instruments, rows.matrix, rows.torque]))
    return exogeneity_f_test(raw, len(rows.torque), "joint").p_value


def pendulum_rejections(count, with_gravity, factor=25):
    rng = np.random.default_rng(3)
    return rejections(wald, pendulums(rng, count, with_gravity=with_gravity, factor=factor))


def test_without_whitening_an_autocorrelated_v_makes_both_tests_reject_the_truth():
    assert rejections(wald_without_whitening, worlds(QUICK, AR1, AR1)) > 0.6
    assert rejections(exogeneity_without_whitening, worlds(QUICK, AR1, AR1)) > 0.6


@pytest.mark.parametrize("test", [wald, exogeneity])
def test_whitening_keeps_the_size(test):
    """150 runs: a true size of 5 % gives more than 10.7 % once in a thousand times."""
    assert rejections(test, worlds(QUICK, AR1, AR1)) < 0.107


def test_forty_five_columns_in_250_rows_do_not_spoil_the_size_of_the_exogeneity_test():
    """A filter fitted on the residual alone rejects in 45 % of these worlds."""
    assert rejections(exogeneity, worlds(QUICK, AR1, AR1, n_rows=250, n_columns=45)) < 0.12


def test_a_deviating_column_is_found_through_autocorrelated_errors():
    assert rejections(wald, worlds(QUICK, AR1, AR1, deviation=0.1)) > 0.9


def test_gravity_left_out_is_rejected_and_gravity_kept_is_accepted():
    assert pendulum_rejections(40, with_gravity=True) < 0.15
    assert pendulum_rejections(40, with_gravity=False) > 0.9


def test_a_stiff_loop_hides_the_missing_gravity_from_the_torque_but_not_from_the_estimate():
    """Why a small effect size is not called a small model error."""
    percents, coulomb = [], []
    for rows, estimate in pendulums(np.random.default_rng(3), 10, with_gravity=False):
        percents.append(wald_test_of_instruments([rows], estimate)[1].torque_deviation_percent)
        coulomb.append(estimate[2])
    assert max(percents) < 1.0
    assert min(coulomb) > 1.3 * 5.0


@pytest.mark.slow
@pytest.mark.parametrize("models", AUTOCORRELATIONS)
@pytest.mark.parametrize("test", [wald, exogeneity])
def test_size_is_between_3_and_8_percent(test, models):
    assert 0.03 <= rejections(test, worlds(FULL, *models)) <= 0.08


@pytest.mark.slow
@pytest.mark.parametrize("options", [{"n_columns": 25, "n_rows": 3000}, {"band": (0.002, 0.2)}])
def test_size_of_the_wald_test_holds_with_more_columns_and_faster_motion(options):
    assert 0.03 <= rejections(wald, worlds(FULL, AR1, AR1, **options)) <= 0.08


@pytest.mark.slow
@pytest.mark.parametrize("models", AUTOCORRELATIONS)
def test_power_of_the_wald_test_is_above_90_percent(models):
    assert rejections(wald, worlds(FULL, *models, deviation=0.1)) > 0.9


@pytest.mark.slow
@pytest.mark.parametrize("models", AUTOCORRELATIONS)
def test_power_of_the_exogeneity_test_is_above_90_percent(models):
    assert rejections(exogeneity, worlds(FULL, *models, endogeneity=1.0)) > 0.9


@pytest.mark.slow
@pytest.mark.parametrize("factor", [25, 10])
def test_pendulum_is_accepted_with_gravity_and_rejected_without(factor):
    assert pendulum_rejections(600, with_gravity=True, factor=factor) <= 0.08
    assert pendulum_rejections(600, with_gravity=False, factor=factor) > 0.9
