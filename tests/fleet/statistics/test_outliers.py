"""Which robots differ from the others, and what they have in common."""

from dataclasses import replace

import numpy as np
import pytest
import scipy
import statsmodels.api as sm

from benchmarks.fleet.synthetic import NAMES, Drawn, fleet
from idim_iv_ros.effects.cause import EffectParameter
from idim_iv_ros.fleet.commands import gap_summary
from idim_iv_ros.fleet.fleet_result import fleet_result
from idim_iv_ros.fleet.result import CauseSummary, CommonCause
from idim_iv_ros.fleet.statistics.common_causes import common_causes, is_nothing, sentences
from idim_iv_ros.fleet.statistics.outliers import choose, outlying
from idim_iv_ros.fleet.statistics.robots import resemblance, types_of
from tests.report.sample_gap import sample_gap

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
    (result,) = choose([p_values])
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


ORDINARY = ["robot_1", "robot_2", "robot_3"]


def level(change: float, std: float = 0.005) -> CauseSummary:
    """Friction at joint_2 that is not the nominal one."""
    numbers = {
        "change_of_viscous": EffectParameter(0.001, 0.01, "N m s/rad"),
        "change_of_coulomb": EffectParameter(change, std, "N m"),
    }
    return CauseSummary("friction_level", "parametric", "joint_2", numbers)


def drift(time: tuple[float, float], coulomb: tuple[float, float]) -> CauseSummary:
    """Friction at joint_2 that fades: time constant and Coulomb part, each with its deviation."""
    numbers = {
        "time_constant": EffectParameter(*time, "s"),
        "coulomb": EffectParameter(*coulomb, "N m"),
        "restarts": EffectParameter(0.0, None, ""),
    }
    return CauseSummary("friction_drift", "structural", "joint_2", numbers)


def gain(factor: float) -> CauseSummary:
    """A torque that is recorded with another gain at joint_1."""
    numbers = {"factor": EffectParameter(factor, 0.01, "")}
    return CauseSummary("torque_gain", "parametric", "joint_1", numbers)


def shown(causes: tuple[CommonCause, ...]) -> list[tuple[set[str], bool]]:
    """Robots of each cause, and whether it is one of the type."""
    return [(set(cause.robots), cause.of_type) for cause in causes]


def test_a_robot_with_another_size_stands_apart_from_its_type() -> None:
    sizes = {"robot_1": -0.05, "robot_2": -0.052, "robot_3": -0.047, "robot_4": 0.6}
    causes = common_causes({name: [level(size)] for name, size in sizes.items()}, ORDINARY)
    assert shown(causes) == [(set(ORDINARY), True), ({"robot_4"}, False)]
    usual, apart = (cause.parameters["change_of_coulomb"] for cause in causes)
    assert usual.value == pytest.approx(-0.0497, abs=1e-4)
    assert usual.std == pytest.approx(0.005 / 3**0.5, rel=1e-6)
    assert (apart.value, apart.std) == (0.6, 0.005)
    said = sentences("arm", causes, list(sizes), ORDINARY)
    assert len(said) == 2
    assert "0.6" in said[1] and "-0.05" in said[1] and "alone" not in said[1]


@pytest.mark.parametrize(
    ("sizes", "groups"),
    [
        ((0.5, 0.42, 0.58), [3]),  # robots of a type scatter
        ((0.05, 0.05, -0.05), [2, 1]),
        ((0.05, -0.05, 0.6), [1, 1, 1]),  # none of the type
        ((0.1, 0.1, 0.6), [2, 1]),
    ],
)
def test_robots_have_a_cause_in_common_where_sign_and_size_agree(sizes, groups) -> None:
    diagnosed = {name: [level(size)] for name, size in zip(ORDINARY, sizes, strict=True)}
    causes = common_causes(diagnosed, ORDINARY)
    assert [len(cause.robots) for cause in causes] == groups
    assert [cause.of_type for cause in causes] == [count >= 2 for count in groups]


def coupling(direction: float) -> CauseSummary:
    """Friction that couples two joints in a direction, 1 or -1."""
    signed = EffectParameter(direction, None, "")
    numbers = {"direction": signed, "coulomb": EffectParameter(0.5, 0.01, "N m")}
    return CauseSummary("joint_coupling", "structural", "joint_1", numbers)


def inertia(moment: str) -> CauseSummary:
    """A change of one moment of a link."""
    numbers = {f"change_of_base_{moment}": EffectParameter(0.1, 0.01, "kg m")}
    return CauseSummary("link_inertia", "parametric", "joint_2", numbers)


@pytest.mark.parametrize(
    ("first", "second", "agree"),
    [
        (level(0.1, 0.2), level(0.5, 0.1), True),  # wide intervals agree with sizes in them
        (gain(1.1), gain(0.9), False),  # compared by its distance from one
        (coupling(1.0), coupling(-1.0), False),
        (inertia("MX2"), inertia("MZ2"), False),  # no number in common
    ],
)
def test_two_robots_agree(first: CauseSummary, second: CauseSummary, agree: bool) -> None:
    causes = common_causes({"robot_1": [first], "robot_2": [second]}, ["robot_1", "robot_2"])
    assert [cause.of_type for cause in causes] == ([True] if agree else [False, False])


def test_a_cause_of_zeros_is_not_named() -> None:
    assert is_nothing(gain(1.015)) and not is_nothing(gain(1.1))
    assert is_nothing(drift((1.1e5, 1.3e6), (40.0, 500.0)))
    assert not is_nothing(drift((30.0, 4.0), (0.5, 0.02)))
    assert not is_nothing(CauseSummary("backlash", "structural", "joint_1"))
    gap = sample_gap()
    zero = {name: EffectParameter(0.1, 1.0, "N m") for name in gap.causes[0].parameters}
    without = replace(gap, causes=(replace(gap.causes[0], parameters=zero), *gap.causes[1:]))
    assert len(gap_summary(gap).causes) == len(gap.causes)
    assert [cause.effect for cause in gap_summary(without).causes] == [
        cause.effect for cause in gap.causes[1:]
    ]
