"""Which robots differ from the others, and whether bags of one resemble each other."""

import numpy as np
import pytest
import scipy
import statsmodels.api as sm

from benchmarks.fleet.synthetic import NAMES, Drawn, fleet
from idim_iv_ros.fleet.fleet_result import fleet_result
from idim_iv_ros.fleet.statistics.outliers import choose, outlying
from idim_iv_ros.fleet.statistics.quantities import types_of
from idim_iv_ros.fleet.statistics.robots import resemblance

ROBOTS, QUANTITIES = 12, 6


def population(seed: int, noise: float = 0.2) -> tuple[np.ndarray, np.ndarray]:
    random = np.random.default_rng(seed)
    values = random.normal(size=(ROBOTS, QUANTITIES))
    variances = np.full(values.shape, noise**2)
    return values + noise * random.normal(size=values.shape), variances


def test_distances_are_externally_studentised_residuals_where_noise_is_equal() -> None:
    values, variances = population(1, 1e-3)
    (result,) = outlying([(values, variances)])
    assert not result.chosen.entries.any()
    for column in range(QUANTITIES):
        fit = sm.OLS(values[:, column], np.ones(ROBOTS)).fit()
        theirs = fit.get_influence().resid_studentized_external
        np.testing.assert_allclose(result.statistics[:, column], theirs, rtol=1e-4)


def test_robots_that_hide_each_other_are_found() -> None:
    values, variances = population(2)
    values[[0, 1, 2], 3] += 9.0
    fit = sm.OLS(values[:, 3], np.ones(ROBOTS)).fit()
    one_by_one = fit.outlier_test()  # columns: statistic, p-value, p-value by Bonferroni
    assert (one_by_one[:3, 1] > 0.02).all(), "each of them hides the others"
    (result,) = outlying([(values, variances)])
    assert result.chosen.units[:3].all() and result.chosen.entries[:3, 3].all()
    assert result.chosen.units[3:].sum() <= 1


@pytest.mark.parametrize("robots", [6, 25])
def test_where_nobody_differs_one_fleet_of_ten_has_a_robot_called(robots: int) -> None:
    random = np.random.default_rng(robots)
    called = 0
    for _ in range(80):
        values = random.normal(size=(robots, QUANTITIES))
        called += outlying([(values, np.full(values.shape, 0.01))])[0].chosen.units.any()
    assert called <= scipy.stats.binom.ppf(0.99, 80, 0.1)


def test_three_robots_are_too_few() -> None:
    values, variances = population(4)
    (result,) = outlying([(values[:3], variances[:3])])
    assert np.isnan(result.p_values).all() and not result.chosen.units.any()


def test_types_share_one_false_discovery_rate() -> None:
    first, second = population(6), population(7)
    first[0][0, 0] += 12.0
    result = outlying([first, second])
    assert result[0].chosen.units[0] and not result[1].chosen.units.any()


def test_quantities_are_chosen_at_the_share_of_chosen_robots() -> None:
    p_values = np.ones((10, 4))
    p_values[0] = [0.0005, 0.004, 0.009, 0.6]
    (result,) = choose([p_values], 0.1)
    # Simes: 4 · 0.0005 = 0.002, chosen by Benjamini-Hochberg below 0.1 / 10. Within the robot the
    # level is 0.1 · 1 / 10: steps of 0.0025, 0.005, 0.0075, 0.01.
    assert result.p_values[0] == pytest.approx(0.002)
    assert result.units.tolist() == [True] + [False] * 9
    assert result.entries[0].tolist() == [True, True, False, False]


CLASSES, BAGS = 12, 20


def wandering(correlation: float, random: np.random.Generator) -> list[float]:
    """A stationary autoregressive series of the first order with deviation 0.3."""
    series = [random.standard_normal()]
    for shock in random.standard_normal(BAGS - 1):
        series.append(correlation * series[-1] + np.sqrt(1.0 - correlation**2) * shock)
    return [0.3 * values for values in series]


def test_slow_movements_of_all_robots_are_noticed_and_said() -> None:
    random = np.random.default_rng(1)
    moving = {(robot, name): wandering(0.8, random) for robot in range(CLASSES) for name in NAMES}
    bags, _ = fleet(Drawn(CLASSES, BAGS, between_bags=0.0, drifting=moving), random)
    correlation = resemblance(types_of(bags)[0].robots)
    assert correlation is not None and 0.1 < correlation < 0.9
    notes = fleet_result(bags[: 8 * BAGS]).types[0].notes
    assert any("bags that follow each other resemble each other" in note for note in notes)


def test_independent_bags_are_seldom_said_to_resemble_each_other() -> None:
    """At a level of 1 %: at most 1 of 20 fleets has a probability of 98 %."""
    seen = 0
    for seed in range(20):
        bags, _ = fleet(Drawn(CLASSES, 8), np.random.default_rng(seed))
        seen += resemblance(types_of(bags)[0].robots) is not None
    assert seen <= 1
