"""One goal on the simulated robot: from the plan to the true parameters."""

import json
from itertools import pairwise
from pathlib import Path

import pytest
from rclpy.action import ActionClient
from std_msgs.msg import String

from idim_iv_interfaces.action import Collect
from tests.ros.conftest import ARM2
from tests.ros.processes import start_launched
from tests.ros.true_parameters import require_truth

LONGEST_SILENCE = 2.0  # s


@pytest.fixture
def collect(tmp_path: Path, stack, observer) -> ActionClient:
    """The four nodes; the action of the collector."""
    robot, bags = {"configuration": str(ARM2)}, {"bag_directory": str(tmp_path / "bags")}
    nodes = {
        "robot_simulator": robot,
        "recorder": {**robot, **bags},
        "identifier": {**robot, **bags, "output_directory": str(tmp_path / "results")},
        "collector": {
            **robot,
            "controller": "robot_simulator",
            "allow_motion": True,
            "motion": "random",
            "speed_scale": 1.0,
            "approach_speed": 0.5,
            "slow_speed": 1.0,
            "start_delay": 60.0,  # it simulates a motion before it begins
            "stale_after": 10.0,
        },
    }
    for name, given in nodes.items():
        stack.callback(start_launched(name, tmp_path, given).end)
    client = ActionClient(observer.node, Collect, "/collector/collect")
    stack.callback(client.destroy)
    observer.until(client.server_is_ready, "the collector")
    observer.be_heard("/collector")
    return client


def test_one_goal_moves_records_checks_and_identifies_the_true_parameters(
    collect, observer, tmp_path: Path
) -> None:
    reach_the_goal(collect, observer, tmp_path)


@pytest.mark.load
def test_a_goal_never_goes_without_a_word_for_long(collect, observer, tmp_path: Path) -> None:
    heard_at = reach_the_goal(collect, observer, tmp_path)
    assert max(after - before for before, after in pairwise(heard_at)) < LONGEST_SILENCE


def reach_the_goal(collect, observer, tmp_path: Path) -> list[float]:
    """Times of the feedback, s."""
    truth = json.loads(observer.latched(String, "/robot_simulator/truth").data)
    places = observer.node.count_publishers
    observer.until(lambda: places("/joint_reference"), "references")
    feedback: list[tuple[float, Collect.Feedback]] = []
    clock = observer.node.get_clock()

    def keep(message) -> None:
        feedback.append((clock.now().nanoseconds * 1e-9, message.feedback))

    goal = Collect.Goal(duration=5.0, identify=True)
    sent = collect.send_goal_async(goal, keep)
    observer.until(sent.done, "an answer")
    future = sent.result().get_result_async()
    observer.until(future.done, "the result")
    answer = future.result().result
    assert answer.success, answer.message
    assert answer.usable
    assert (tmp_path / "bags" / answer.bag).is_dir()
    assert answer.message.startswith(f"{answer.bag}: ")
    require_truth(answer.result.parameters, truth)
    stages = {"moving to the start", "slow pass", "recording", "checking", "validation"}
    observer.until(lambda: stages <= {each.stage for _, each in feedback}, f"{stages}")
    return [time for time, _ in feedback]
