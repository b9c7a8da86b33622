"""Bags that follow each other and resemble each other: where changes are not to be trusted."""

import numpy as np

from benchmarks.fleet.synthetic import NAMES, Drawn, fleet
from idim_iv_ros.fleet.fleet_result import fleet_result
from idim_iv_ros.fleet.statistics.quantities import types_of
from idim_iv_ros.fleet.statistics.robots import resemblance

ROBOTS, BAGS = 12, 20


def wandering(correlation: float, random: np.random.Generator) -> list[float]:
    """A stationary autoregressive series of the first order with deviation 0.3."""
    series = [random.standard_normal()]
    for shock in random.standard_normal(BAGS - 1):
        series.append(correlation * series[-1] + np.sqrt(1.0 - correlation**2) * shock)
    return [0.3 * values for values in series]


def test_slow_movements_of_all_robots_are_noticed_and_said() -> None:
    random = np.random.default_rng(1)
    moving = {(robot, name): wandering(0.8, random) for robot in range(ROBOTS) for name in NAMES}
    bags, _ = fleet(Drawn(ROBOTS, BAGS, between_bags=0.0, drifting=moving), random)
    correlation = resemblance(types_of(bags)[0].robots)
    assert correlation is not None and 0.1 < correlation < 0.9
    notes = fleet_result(bags[: 8 * BAGS]).types[0].notes
    assert any("bags that follow each other resemble each other" in note for note in notes)


def test_independent_bags_are_seldom_said_to_resemble_each_other() -> None:
    """At a level of 1 %: at most 1 of 20 fleets has a probability of 98 %."""
    seen = 0
    for seed in range(20):
        bags, _ = fleet(Drawn(ROBOTS, 8), np.random.default_rng(seed))
        seen += resemblance(types_of(bags)[0].robots) is not None
    assert seen <= 1
