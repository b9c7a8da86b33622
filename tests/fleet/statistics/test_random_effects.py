"""Random effects against published numbers, statsmodels and closed forms."""

import numpy as np
import pytest
import scipy
import statsmodels.api as sm
from statsmodels.stats.meta_analysis import combine_effects

from idim_iv_ros.estimation.qr import r_factor
from idim_iv_ros.fleet.regression import stacked
from idim_iv_ros.fleet.statistics.random_effects import (
    between_variance,
    common_between_variance,
    type_estimate,
)
from idim_iv_ros.fleet.statistics.robots import regression, shares

# Thirteen trials of a vaccine (Colditz et al., JAMA 271, 1994): ill and well, with and without it.
ILL = np.array([4, 6, 3, 62, 33, 180, 8, 505, 29, 17, 186, 5, 27])
WELL = np.array([119, 300, 228, 13536, 5036, 1361, 2537, 87886, 7470, 1699, 50448, 2493, 16886])
ILL_WITHOUT = np.array([11, 29, 11, 248, 47, 372, 10, 499, 45, 65, 141, 3, 29])
WELL_WITHOUT = np.array(
    [128, 274, 209, 12619, 5761, 1079, 619, 87892, 7232, 1600, 27197, 2338, 17825]
)


def risk_ratios() -> tuple[np.ndarray, np.ndarray]:
    """Logarithms of the risk ratios, and their variances."""
    treated, control = ILL + WELL, ILL_WITHOUT + WELL_WITHOUT
    values = np.log((ILL / treated) / (ILL_WITHOUT / control))
    return values, 1 / ILL - 1 / treated + 1 / ILL_WITHOUT - 1 / control


def estimate_of(values: np.ndarray, variances: np.ndarray) -> dict[str, float]:
    """The estimate of one quantity."""
    columns = type_estimate(values[:, None], variances[:, None])
    return {name: float(column[0]) for name, column in columns.items()}


def test_q_profile_interval_is_that_of_metafor_on_the_vaccine_trials() -> None:
    # R, metafor: confint(rma(measure="RR", ai=tpos, bi=tneg, ci=cpos, di=cneg, data=dat.bcg))
    # tau^2 0.3132, 0.1197 to 1.1115.
    values, variances = risk_ratios()
    estimate = estimate_of(values, variances)
    assert estimate["sigma_low"] ** 2 == pytest.approx(0.1197, abs=1e-4)
    assert estimate["sigma_high"] ** 2 == pytest.approx(1.1115, abs=1e-4)


def test_columns_are_separate_and_unknown_units_count_for_nothing() -> None:
    random = np.random.default_rng(3)
    values = random.normal(size=(9, 4)) * [1.0, 3.0, 0.1, 10.0]
    variances = random.uniform(0.1, 0.5, size=(9, 4))
    values[2, 1] = np.nan
    estimate = between_variance(values, variances)
    for column in range(4):
        estimated = np.isfinite(values[:, column])
        theirs = combine_effects(values[estimated, column], variances[estimated, column]).tau2
        assert estimate[column] == pytest.approx(theirs, rel=1e-4, abs=1e-9)


def test_with_equal_variances_all_intervals_are_those_of_a_normal_sample() -> None:
    values, variance = np.random.default_rng(1).normal(5.0, 2.0, size=15), 0.3
    estimate = estimate_of(values, np.full(15, variance))
    squares = float(np.sum((values - values.mean()) ** 2))
    mean = scipy.stats.ttest_1samp(values, 0.0).confidence_interval(0.95)
    assert estimate["mean"] == pytest.approx(values.mean())
    assert (estimate["mean_low"], estimate["mean_high"]) == pytest.approx(
        (mean.low, mean.high), rel=1e-4
    )
    assert estimate["sigma"] ** 2 == pytest.approx(squares / 14 - variance, rel=1e-4)
    ends = squares / scipy.stats.chi2.isf([0.025, 0.975], 14) - variance
    assert (estimate["sigma_low"] ** 2, estimate["sigma_high"] ** 2) == pytest.approx(tuple(ends))
    ahead = scipy.stats.t.isf(0.025, 13) * np.sqrt(squares / 14 * (1 + 1 / 15) - variance)
    assert estimate["next_high"] - estimate["mean"] == pytest.approx(ahead, rel=1e-4)


def test_units_that_differ_less_than_their_noise_make_no_narrow_interval() -> None:
    estimate = estimate_of(np.array([1.0, 1.001, 0.999, 1.0005]), np.full(4, 0.04))
    assert estimate["sigma"] == 0.0
    half = scipy.stats.t.isf(0.025, 3) * 0.2 / 2.0
    assert estimate["mean_high"] - estimate["mean"] == pytest.approx(half)


def test_mean_and_interval_are_those_of_statsmodels_on_the_vaccine_trials() -> None:
    values, variances = risk_ratios()
    theirs = combine_effects(values, variances, method_re="iterated", use_t=True)
    between = between_variance(values[:, None], variances[:, None])  # of Paule and Mandel
    assert between[0] == pytest.approx(theirs.tau2, 1e-4)
    estimate = estimate_of(values, variances)
    low, high = theirs.conf_int()[3]  # random effects, Hartung and Knapp
    assert estimate["mean"] == pytest.approx(theirs.mean_effect_re, rel=1e-4)
    assert (estimate["mean_low"], estimate["mean_high"]) == pytest.approx((low, high), rel=1e-4)


def test_variance_common_to_groups_is_not_moved_by_a_third_of_them() -> None:
    random = np.random.default_rng(5)
    groups = []
    for number in range(60):
        spread = 1.0 if number % 3 else 8.0
        noise = random.uniform(0.1, 0.4, size=(6, 1))
        values = spread * random.normal(size=(6, 1)) + np.sqrt(noise) * random.normal(size=(6, 1))
        groups.append((values, noise))
    ordinary = [group for number, group in enumerate(groups) if number % 3]
    alone = common_between_variance(ordinary)[0]
    assert alone == pytest.approx(1.0, abs=0.35)
    assert common_between_variance(groups)[0] < 2.2 * alone


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
