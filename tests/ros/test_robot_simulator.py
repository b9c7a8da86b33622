"""The simulated robot in real time, alone and with the recorder."""

import json
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool, String
from std_srvs.srv import Trigger
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from idim_iv_ros import load_configuration
from idim_iv_ros.recording import read_recordings
from tests.ros.identifier_client import IdentifierClient
from tests.ros.launch_file import launched_nodes
from tests.ros.processes import HANG, LATCHED, ROOT, Process, only_bag, start_launched, start_node
from tests.ros.true_parameters import require_truth

CONFIG = ROOT / "config" / "arm2.yaml"


@pytest.fixture
def simulator(tmp_path: Path, stack):
    def start(**parameters: object) -> Process:
        process = start_node("robot_simulator", tmp_path, configuration=CONFIG, **parameters)
        stack.callback(process.end)
        return process

    return start


def move(observer, name: str) -> Trigger.Response:
    return observer._request(Trigger, f"/{name}/move", Trigger.Request())


@pytest.fixture
def demo(tmp_path: Path, stack, observer) -> IdentifierClient:
    """The nodes of demo.launch.py; the observer follows its recorder."""
    folders = {name: str(tmp_path / name) for name in ("bags", "results")}
    nodes = launched_nodes(ROOT / "launch" / "demo.launch.py", configuration=str(CONFIG), **folders)
    processes = {name: start_launched(name, tmp_path, given) for name, given in nodes.items()}
    for process in processes.values():
        stack.callback(process.end)
    observer.follow(processes["recorder"])
    client = IdentifierClient(observer, processes["identifier"])
    stack.callback(client.close)
    return client


def test_demo_identifies_the_true_parameters_from_a_recorded_motion(
    demo, observer, tmp_path: Path
) -> None:
    """Simulator, recorder, bag, identifier: as announced, and once more on request."""
    truth = json.loads(observer.latched(String, "/robot_simulator/truth").data)
    observer.until(lambda: observer.topic("/joint_reference").received > 200, "references")
    assert observer.call("start").success
    moving: list[bool] = []
    heard_moving = observer.node.create_subscription(
        Bool, "/robot_simulator/moving", lambda message: moving.append(message.data), LATCHED
    )
    observer.until(lambda: moving, "that it rests")
    assert move(observer, "robot_simulator").success
    observer.until(lambda: moving[-2:] == [True, False], "the motion")
    observer.node.destroy_subscription(heard_moving)
    assert observer.call("stop").success
    bag = only_bag(tmp_path / "bags")
    configuration = load_configuration(CONFIG)
    (recording,) = read_recordings(
        [bag], joints=configuration.robot.joints, reference="/joint_reference"
    )
    assert abs(recording.rate - 1000.0) < 1.0
    observer.until(lambda: "joint_2" in demo.diagnostics, "the result of the announced bag")
    announced = demo.latched().parameters
    answer = demo.identify(bag.name)
    assert answer.success, answer.message
    require_truth(answer.result.parameters, truth)
    assert list(announced.bags) == [bag.name]
    assert announced.estimates == answer.result.parameters.estimates


def test_it_answers_while_it_compiles_and_can_be_interrupted(
    simulator, observer, monkeypatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "cache"))
    process = simulator()
    observer.latched(String, "/robot_description")
    refused = move(observer, process.name)
    assert not refused.success
    assert "compiled" in refused.message
    text = process.errors.read_text
    observer.until(lambda: "joint states follow" in text(), "a line that says so")
    assert process.finish() == 0
    assert "Traceback" not in text()


@pytest.mark.load
def test_first_move_begins_at_once_where_nothing_was_compiled(
    simulator, observer, monkeypatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "cache"))
    process = simulator(motion_duration=2.0)
    places: list[float] = []
    heard = observer.node.create_subscription(
        JointState, "/joint_reference", lambda message: places.append(message.position[0]), 10
    )
    observer.until(lambda: len(places) > 100, "references")
    begin = time.perf_counter()
    assert move(observer, process.name).success
    observer.until(lambda: abs(places[-1] - places[0]) > 1e-3, "the motion")
    assert time.perf_counter() - begin < 2.0
    observer.node.destroy_subscription(heard)


def test_joint_trajectory_is_followed(simulator, recorder, observer, bags: Path) -> None:
    topic = f"/{simulator().name}/joint_trajectory"
    recorder(record=True, configuration=str(CONFIG))
    sender = observer.node.create_publisher(JointTrajectory, topic, 1)
    observer.until(lambda: sender.get_subscription_count() == 1, "the simulator")
    points = []
    for seconds, places in ((0, [0.2, 0.3]), (1, [0.5, 0.1])):
        point = JointTrajectoryPoint(positions=places, velocities=[0.0, 0.0])
        point.time_from_start.sec = seconds
        points.append(point)
    observer.until(lambda: observer.topic("/joint_states").received > 100, "rest")
    sender.publish(JointTrajectory(joint_names=["joint_1", "joint_2"], points=points))
    references: list[list[float]] = [[]]
    heard = observer.node.create_subscription(
        JointState,
        "/joint_reference",
        lambda message: references.__setitem__(0, list(message.position)),
        10,
    )
    observer.until(
        lambda: references[0] and np.allclose(references[0], [0.5, 0.1]),
        "the end of the motion",
    )
    before = observer.topic("/joint_states").received
    observer.until(lambda: observer.topic("/joint_states").received > before + 1000, "rest")
    observer.node.destroy_subscription(heard)
    observer.call("stop")
    observer.node.destroy_publisher(sender)
    (recording,) = read_recordings(
        [only_bag(bags)], joints=["joint_1", "joint_2"], reference="/joint_reference"
    )
    assert recording.position_reference is not None
    reference = recording.position_reference.values
    assert np.allclose(reference[-1], [0.5, 0.1], atol=1e-6)
    assert np.abs(np.diff(reference, axis=0)).max() < 0.005
    assert np.abs(recording.position.values[-500:].mean(axis=0) - reference[-1]).max() < 0.1


def test_start_without_configuration_is_one_line(tmp_path: Path) -> None:
    script = str(ROOT / "scripts" / "robot_simulator")
    named = ["--ros-args", "-r", "__node:=alone"]
    process = Process([sys.executable, script, *named], tmp_path, "alone")
    assert process.process.wait(HANG) == 2
    lines = process.errors.read_text().splitlines()
    assert lines == [
        "robot_simulator: parameter configuration: name it: --ros-args -p configuration:=ROBOT.yaml"
    ]


def test_wrong_parameters_are_refused_when_set(simulator, observer, tmp_path: Path) -> None:
    name_of_node = simulator().name
    broken = tmp_path / "motion.csv"
    broken.write_text("nothing\n")
    for name, value, words in (
        ("motion_duration", 0.1, "range"),
        ("seed", -1, "range"),
        ("configuration", "other.yaml", "read-only"),
        ("trajectory", str(tmp_path / "missing.csv"), "missing.csv"),
        ("trajectory", str(broken), "motion.csv"),
    ):
        (result,) = observer.set_on(name_of_node, **{name: value})
        assert not result.successful
        assert words in result.reason, result.reason
