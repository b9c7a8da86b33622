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
def test_a_minute_of_seven_joints_and_reference_at_1_khz(
    mortal_recorder, robot, observer, bags: Path, seven_joints: Path
) -> None:
    process = mortal_recorder(configuration=str(seven_joints), status_period=1.0)
    topics = [
        {"name": name, "joints": JOINTS, "depth": 1000}
        for name in ("/joint_states", "/joint_reference")
    ]
    robot.begin(count=60_000, rate=1000.0, pace=True, topics=topics)
    observer.call("start")
    before = process.cpu()
    robot.run()
    share = (process.cpu() - before) / 60.0
    for topic in ("/joint_states", "/joint_reference"):
        observer.received(60_000, topic)
        assert observer.topic(topic).lost == 0
    observer.call("stop")
    for topic in ("/joint_states", "/joint_reference"):
        assert np.array_equal(numbers(only_bag(bags), topic), np.arange(60_000.0))
    print(f"processor time: {100 * share:.1f} % of one core, publisher {robot.seconds:.1f} s")
    assert robot.seconds < 63.0
    assert share <= 0.25


@pytest.mark.load
def test_20_s_at_10_khz(mortal_recorder, robot, observer, bags: Path) -> None:
    process = mortal_recorder(status_period=1.0)
    states = [{"name": "/joint_states", "joints": JOINTS, "depth": 1000}]
    robot.begin(count=200_000, rate=10_000.0, pace=True, topics=states)
    observer.call("start")
    before = process.cpu()
    robot.run()
    share = (process.cpu() - before) / 20.0
    assert robot.seconds < 21.0, "the publisher could not keep up: is the machine idle?"
    observer.received(200_000)
    assert observer.topic("/joint_states").lost == 0
    observer.call("stop")
    assert np.array_equal(numbers(only_bag(bags)), np.arange(200_000.0))
    print(f"processor time: {100 * share:.1f} % of one core")
