"""One answer from the results of many bags, drawn with a known truth."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.fleet.coverage import coverage
from benchmarks.fleet.synthetic import NAMES, SIGMA, Drawn, fleet
from idim_iv_ros.errors import UsageError
from idim_iv_ros.fleet.fleet_result import fleet_result
from idim_iv_ros.fleet.result import BagResult, CauseSummary, FleetResult, FleetRobot, GapSummary

STEP = [0.0] * 5 + [4.0] * 3
DRAWN = Drawn(
    robots=10,
    bags=8,
    planted={(0, "MX2"): 14.0, (1, "joint_2"): 1.2},
    drifting={(3, "Fc1"): STEP, (4, "off2"): STEP},
)


def broken(bag: BagResult, reason: str = "the file is cut off") -> BagResult:
    """The row of a bag that cannot be read."""
    about = {name: getattr(bag, name) for name in ("uri", "robot", "type", "time")}
    return BagResult(**about, content="", status="corrupt", reason=reason)


def robot_of(result: FleetResult, name: str) -> FleetRobot:
    """The robot of that name."""
    return next(robot for robot in result.robots if robot.robot == name)


@pytest.fixture(scope="module")
def bags() -> Sequence[BagResult]:
    """A fleet with two robots that differ and two that changed; one bag is corrupt."""
    results, _ = fleet(DRAWN, np.random.default_rng(11))
    results[20] = broken(results[20])
    return results


@pytest.fixture(scope="module")
def answer(bags: Sequence[BagResult]) -> FleetResult:
    """What is said of it."""
    return fleet_result(bags)


def test_planted_robots_differ_in_what_was_planted(answer: FleetResult) -> None:
    for name, quantity in (("arm2-001", "MX2"), ("arm2-002", "residual joint_2")):
        robot = robot_of(answer, name)
        assert robot.attention == "differs"
        assert quantity in [q.name for q in robot.quantities if q.differs]
        assert any(quantity.split()[-1] in reason for reason in robot.reasons)


def test_changes_are_dated(answer: FleetResult) -> None:
    for name, quantity in (("arm2-004", "Fc1"), ("arm2-005", "off2")):
        (change,) = (one for one in robot_of(answer, name).changes if one.name == quantity)
        assert change.kind == "step"
        assert abs(change.times.index(change.begin) - 5) <= 2
        assert change.begin_low <= change.times[5] <= change.begin_high
        size = 4.0 * SIGMA[NAMES.index(quantity)]
        # Twice the interval: that it covers as often as it says is a matter of many changes.
        assert abs(change.size - size) < change.size_high - change.size_low


def test_every_bag_is_listed_and_a_corrupt_one_with_its_reason(answer, bags) -> None:
    assert [bag.uri for bag in answer.bags] == [bag.uri for bag in bags]
    (unused,) = (bag for bag in answer.bags if not bag.used)
    assert unused.status == "corrupt" and unused.why_not == "the file is cut off"
    assert robot_of(answer, unused.robot).not_used == 1


def test_the_robots_that_stand_out_are_screened_and_ordinary_ones_for_the_type(answer) -> None:
    why = {screened.robot: screened.why for screened in answer.screen}
    assert why["arm2-001"] == why["arm2-002"] == "differs"
    assert why["arm2-004"] == why["arm2-005"] == "changed"
    assert list(why.values()).count("typical") == 3
    (bags,) = (screened.bags for screened in answer.screen if screened.robot == "arm2-001")
    assert bags == tuple(f"arm2-001/0{number}.mcap" for number in (8, 7, 6))


def test_the_order_of_bags_does_not_matter(answer: FleetResult, bags: Sequence[BagResult]) -> None:
    again = fleet_result(list(reversed(bags)))
    for one, other in zip(answer.robots, again.robots, strict=True):
        assert one.robot == other.robot and one.attention == other.attention
        values = [[q.value for q in robot.quantities] for robot in (one, other)]
        np.testing.assert_allclose(*values, rtol=1e-9)


def test_one_robot_is_estimated_and_compared_with_nobody(bags: Sequence[BagResult]) -> None:
    alone = fleet_result([bag for bag in bags if bag.robot == "arm2-004"])
    (robot,) = alone.robots
    assert robot.attention == "changed"
    assert not any(quantity.differs for quantity in robot.quantities)
    assert all(np.isnan(quantity.p_value) for quantity in robot.quantities)
    assert any("nothing says what is ordinary" in note for note in alone.types[0].notes)


def test_bags_of_another_model_are_left_out(bags: Sequence[BagResult]) -> None:
    odd = replace(bags[9], kinematics="another arm")
    mixed = fleet_result([*bags[:9], odd, *bags[10:16]])
    (unused,) = (bag for bag in mixed.bags if not bag.used)
    assert unused.uri == odd.uri and "not those of most bags of arm2" in unused.why_not


def test_a_fleet_of_corrupt_bags_is_an_answer_and_no_bag_is_none() -> None:
    results, _ = fleet(Drawn(robots=1, bags=2), np.random.default_rng(1))
    nothing = fleet_result([broken(bag) for bag in results])
    assert nothing.robots[0].attention == "recordings" and not nothing.types
    with pytest.raises(UsageError, match="at least one bag"):
        fleet_result([])


def test_bags_that_differ_from_day_to_day_make_no_narrow_interval() -> None:
    drawn = Drawn(robots=8, bags=6, noise=(0.05, 0.1), between_bags=1.0)
    results, truths = fleet(drawn, np.random.default_rng(21))
    answer = fleet_result(results)
    inside = [
        quantity.low <= truth <= quantity.high
        for number, row in enumerate(truths)
        for quantity, truth in zip(
            robot_of(answer, f"arm2-{number + 1:03d}").quantities, row, strict=False
        )
    ]
    # 104 intervals of 95 %; with the noise of the rows alone a fifth would hold the truth.
    assert np.mean(inside) > 0.87


def test_diagnoses_say_what_is_of_the_type_and_what_is_of_one_robot(answer, bags) -> None:
    shared = CauseSummary("load_dependent_friction", "structural", "joint_2")
    backlash = CauseSummary("backlash", "structural", "joint_1")
    typical = [screened.robot for screened in answer.screen if screened.why == "typical"]
    causes = dict.fromkeys(typical, (shared,)) | {"arm2-001": (shared, backlash)}
    diagnosed = [
        replace(bag, diagnosis=GapSummary("structural", causes[bag.robot]))
        if bag.uri.endswith("08.mcap") and bag.robot in causes
        else bag
        for bag in bags
    ]
    (kind,) = fleet_result(diagnosed).types
    assert [(c.effect, c.of_type, len(c.robots)) for c in kind.causes] == [
        ("load_dependent_friction", True, 4),
        ("backlash", False, 1),
    ]
    assert len(kind.sentences) == 2


@pytest.mark.slow
@pytest.mark.parametrize("special", [False, True])
def test_intervals_cover_and_discoveries_are_rarely_false(special: bool) -> None:
    counts = coverage(100, special=special)
    assert 0.90 <= counts.mean / counts.quantities <= 0.98
    assert 0.90 <= counts.sigma / counts.quantities <= 0.98
    assert np.mean(counts.false_shares) <= 0.1 + 2.0 * np.std(counts.false_shares) / 10.0
    if special:
        assert counts.detected >= 0.9 * counts.planted
        assert counts.dates >= 0.9 * counts.drifting


def test_one_bag_a_robot_says_that_days_are_unknown(bags: Sequence[BagResult]) -> None:
    single = fleet_result([bag for bag in bags if bag.uri.endswith("01.mcap")])
    assert any("no robot has two bags" in note for note in single.types[0].notes)
    assert np.isnan(single.types[0].quantities[0].between_bags)
    assert np.isfinite(single.types[0].quantities[0].sigma)
