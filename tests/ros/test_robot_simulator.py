"""The simulated robot in real time: alone, and with all nodes of the demo."""

import json
import time
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from rclpy.action import ActionClient
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool, String

from idim_iv_interfaces.action import Collect
from idim_iv_ros import load_configuration
from idim_iv_ros.recording.read import read_recordings
from tests.ros.conftest import ARM2
from tests.ros.identifier_client import IdentifierClient, require_truth
from tests.ros.launch_file import launched_nodes
from tests.ros.processes import LATCHED, ROOT, end_all, start_launched, start_node

LONGEST_SILENCE = 2.0  # s


@pytest.fixture
def demo(tmp_path: Path, stack, observer) -> tuple[IdentifierClient, ActionClient]:
    """The nodes of demo.launch.py, with a robot that is moved at once and fast.

    Bags are identified because the collector asks: those that are announced, by test_identifier.py.
    """
    folders = {name: str(tmp_path / name) for name in ("bags", "results")}
    nodes = launched_nodes(ROOT / "launch" / "demo.launch.py", configuration=str(ARM2), **folders)
    del nodes["predictor"]
    nodes["identifier"]["auto"] = False
    nodes["collector"] |= {
        "allow_motion": True,
        "motion": "random",
        "speed_scale": 1.0,
        "approach_speed": 0.5,
        "slow_speed": 1.0,
        "stale_after": 10.0,
    }
    processes = {name: start_launched(name, tmp_path, given) for name, given in nodes.items()}
    stack.callback(end_all, processes.values())
    client = IdentifierClient(observer, processes["identifier"])
    stack.callback(client.close)
    collect = ActionClient(observer.node, Collect, "/collector/collect")
    stack.callback(collect.destroy)
    observer.until(collect.server_is_ready, "the collector")
    observer.be_heard("/collector")
    return client, collect


def reach_the_goal(demo, observer, bags: Path) -> list[float]:
    """Move, record, check, identify; return the times of the feedback, s."""
    client, collect = demo
    truth = json.loads(observer.latched(String, "/robot_simulator/truth").data)
    observer.until(lambda: observer.node.count_publishers("/joint_reference"), "references")
    feedback: list[tuple[float, Collect.Feedback]] = []
    clock = observer.node.get_clock()

    def keep(message) -> None:
        feedback.append((clock.now().nanoseconds * 1e-9, message.feedback))

    goal = Collect.Goal(duration=5.0, identify=True)
    answer = client.wait(client.wait(collect.send_goal_async(goal, keep)).get_result_async()).result
    assert answer.success, answer.message
    assert answer.usable
    assert answer.message.startswith(f"{answer.bag}: ")
    require_truth(answer.result.parameters, truth)
    stages = {"moving to the start", "slow pass", "recording", "checking", "validation"}
    observer.until(lambda: stages <= {message.stage for _, message in feedback}, f"{stages}")
    configuration = load_configuration(ARM2)
    (recording,) = read_recordings(
        [bags / answer.bag], joints=configuration.robot.joints, reference="/joint_reference"
    )
    assert abs(recording.rate - 1000.0) < 1.0
    return [time for time, _ in feedback]


def test_one_goal_of_the_demo_identifies_the_true_parameters(demo, observer, tmp_path) -> None:
    """The robot follows the trajectories of the collector; then it moves when it is asked to."""
    reach_the_goal(demo, observer, tmp_path / "bags")
    name = "robot_simulator"
    moving: list[bool] = []
    places: list[list[float]] = []
    subscribe = observer.node.create_subscription
    subscriptions = [
        subscribe(Bool, f"/{name}/moving", lambda heard: moving.append(heard.data), LATCHED),
        subscribe(JointState, "/joint_reference", lambda heard: places.append(heard.position), 99),
    ]
    observer.until(lambda: moving[-1:] == [False], "rest")
    assert observer.set_on(name, motion_duration=1.0)[0].successful
    observer.call("move", name)
    # Two topics: the end of the motion may be heard before its references.
    observer.until(lambda: np.ptp(places, axis=0).max() > 0.1, "the references of the motion")
    observer.until(lambda: moving[-2:] == [True, False], "the motion")
    for subscription in subscriptions:
        observer.node.destroy_subscription(subscription)
    observer.forget(name)


@pytest.mark.load
def test_a_goal_never_goes_without_a_word_for_long(demo, observer, tmp_path: Path) -> None:
    heard_at = reach_the_goal(demo, observer, tmp_path / "bags")
    assert max(after - before for before, after in pairwise(heard_at)) < LONGEST_SILENCE


@pytest.mark.load
def test_first_move_begins_at_once_where_nothing_was_compiled(
    stack, observer, monkeypatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "cache"))
    given = {"configuration": ARM2, "motion_duration": 2.0}
    process = start_node("robot_simulator", tmp_path, **given)
    stack.callback(process.end)
    places: list[float] = []
    heard = observer.node.create_subscription(
        JointState, "/joint_reference", lambda message: places.append(message.position[0]), 10
    )
    observer.until(lambda: len(places) > 100, "references")
    begin = time.perf_counter()
    observer.call("move", process.name)
    observer.until(lambda: abs(places[-1] - places[0]) > 1e-3, "the motion")
    assert time.perf_counter() - begin < 2.0
    observer.node.destroy_subscription(heard)
