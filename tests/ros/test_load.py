"""High rates: nothing is lost, and how much of a core it takes."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tests.ros.processes import numbers, only_bag

JOINTS = [f"joint_{k}" for k in range(1, 8)]


@pytest.fixture
def seven_joints(robot_file: Callable[[str], Path]) -> Path:
    return robot_file(
        f"robot:\n  joints: [{', '.join(JOINTS)}]\nsignals:\n  reference: /joint_reference\n"
    )


@pytest.mark.load
@pytest.mark.parametrize(
    ("topics", "seconds", "rate", "most"),
    [(["/joint_states", "/joint_reference"], 60, 1000, 0.25), (["/joint_states"], 20, 10_000, 0.5)],
    ids=["a minute of states and references at 1 kHz", "20 s of states at 10 kHz"],
)
def test_seven_joints_without_loss(
    mortal_recorder, robot, observer, bags: Path, seven_joints, topics, seconds, rate, most
) -> None:
    """`most`: the share of a core that the recorder may take."""
    process = mortal_recorder(configuration=str(seven_joints), status_period=1.0)
    count = seconds * rate
    published = [{"name": name, "joints": JOINTS, "depth": 1000} for name in topics]
    robot.begin(count=count, rate=float(rate), pace=True, topics=published)
    observer.call("start")
    before = process.cpu()
    robot.run()
    share = (process.cpu() - before) / seconds
    assert robot.seconds < 1.05 * seconds, "the publisher could not keep up: is the machine idle?"
    for topic in topics:
        observer.received(count, topic)
        assert observer.topic(topic).lost == 0
    observer.call("stop")
    for topic in topics:
        assert np.array_equal(numbers(only_bag(bags), topic), np.arange(float(count)))
    print(f"processor time: {100 * share:.1f} % of one core, publisher {robot.seconds:.1f} s")
    assert share <= most
