"""The same recordings in another order, with whatever stamps, give the same diagnosis."""

from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bags.simulated_arms import SimulatedArm, arm2, record
from idim_iv_ros.diagnosis.diagnose import diagnose
from idim_iv_ros.diagnosis.result.document import GapResult
from idim_iv_ros.effects.registry import EFFECTS
from idim_iv_ros.recording.writing.write import JointTopic, write_bag
from idim_iv_ros.report.page import gap_report_html

SECONDS = 3.0
JOINTS = ["joint_1", "joint_2"]
# What depends on the time of the session stays in; the others would only take longer.
WITHOUT = tuple(name for name in EFFECTS if name not in ("friction_drift", "spring"))
Bags = Callable[[Sequence[float]], list[Path]]


@pytest.fixture(scope="module")
def arm() -> SimulatedArm:
    return arm2(seconds=SECONDS)


@pytest.fixture(scope="module")
def bags(tmp_path_factory: pytest.TempPathFactory) -> Bags:
    """Three runs of the arm whose first stamps are given."""
    records = [record(arm2(seconds=SECONDS, seed=seed), seed) for seed in (1, 2, 3)]

    @cache
    def bag(number: int, start: float) -> Path:
        one = records[number]
        time = one.time - one.time[0] + start
        path = tmp_path_factory.mktemp("bags") / f"run{number}.mcap"
        topics = [
            JointTopic("/joint_states", JOINTS, time, one.position, None, one.effort),
            JointTopic("/joint_reference", JOINTS, time, one.position_reference),
        ]
        write_bag(path, topics)
        return path

    return lambda starts: [bag(number, start) for number, start in enumerate(starts)]


def without_timing(document: dict[str, Any]) -> dict[str, Any]:
    """Without what is found by a solver that ends within its tolerance, too."""
    return {key: value for key, value in document.items() if key not in ("timing", "physical")}


def is_increasing(result: GapResult) -> bool:
    return all(bool(np.all(np.diff(series.time) > 0.0)) for series in result.series)


STARTS = (3.0, 0.0, 5.0)  # s: they overlap


def test_any_order_of_bags_gives_the_same_gap(bags: Bags, arm: SimulatedArm) -> None:
    paths = bags(STARTS)
    in_time = [paths[k].name for k in np.argsort(STARTS)]
    orders = [paths, [paths[1], paths[2], paths[0]]]
    results = [diagnose(order, arm.configuration, without=WITHOUT) for order in orders]
    for result in results:
        assert list(result.bags) == in_time
        assert is_increasing(result)
        assert "Measured and modelled torque" in gap_report_html(result)
    first, second = (result.to_document() for result in results)
    assert without_timing(first) == without_timing(second)
    for a, b in zip(first["physical"]["base"], second["physical"]["base"], strict=True):
        assert abs(a["value"] - b["value"]) < 0.01 * a["std"]


def test_bags_that_start_at_the_same_stamp_give_the_same_causes_in_any_order(bags, arm) -> None:
    """Simulated bags: stamps say nothing of their order, and no row is lost or counted twice."""
    paths = bags((0.0, 0.0, 0.0))
    orders = [paths, paths[::-1]]
    one, two = (diagnose(order, arm.configuration, without=WITHOUT) for order in orders)
    for result, order in ((one, orders[0]), (two, orders[1])):
        assert list(result.bags) == [path.name for path in order]
        assert is_increasing(result)
    assert one.verdict == two.verdict
    assert [(c.effect, c.joint) for c in one.causes] == [(c.effect, c.joint) for c in two.causes]
    for a, b in zip(one.stages, two.stages, strict=True):
        assert a.torque_rms == pytest.approx(b.torque_rms, rel=1e-6)
