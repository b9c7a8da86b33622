"""A robot is moved only as far and as long as everything is as it should be."""

import re
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pytest
from action_msgs.msg import GoalStatus, GoalStatusArray
from rclpy.action import ActionClient

from idim_iv_interfaces.action import Collect
from idim_iv_interfaces.msg import RecorderStatus
from idim_iv_ros import load_configuration
from idim_iv_ros.excitation.excite import load_model
from idim_iv_ros.excitation.limits import motion_limits
from idim_iv_ros.nodes.collector.neighbours import RecorderNeighbour
from tests.ros.conftest import ARM2
from tests.ros.kinematic_robot import KinematicRobot
from tests.ros.processes import Observer, Process, start_node

STOPPED = 1.0  # s within which a robot rests; a hundredth of that is the controller's
LIMIT = 0.1  # rad
# What a busy machine takes longer than is allowed for nothing; tests of limits set others.
PATIENT = {"stale_after": 10.0, "start_delay": 60.0, "slow_speed": 0.5}
STALE = 3.0  # s


class Collector:
    """Sends goals to one collector, beside a robot that the observer spins."""

    def __init__(self, observer: Observer, process: Process) -> None:
        self.observer, self.process = observer, process
        self.feedback: list[Collect.Feedback] = []
        self.connect()

    def connect(self) -> None:
        name = f"/{self.process.name}/collect"
        self.action = ActionClient(self.observer.node, Collect, name)
        self.observer.until(self.action.server_is_ready, "the action")
        self.observer.be_heard(f"/{self.process.name}")

    def send(self, **request: object):
        """Send a goal and return its handle."""
        self.feedback = heard = []
        goal = Collect.Goal(**{"duration": 1.0, "identify": False, **request})
        return self.observer.wait(
            self.action.send_goal_async(goal, lambda message: heard.append(message.feedback))
        )

    def result(self, goal):
        return self.observer.wait(goal.get_result_async())

    def collect(self, **request: object):
        return self.result(self.send(**request)).result

    def until(self, stage: str, also: Callable[[], object] = lambda: True) -> None:
        """Wait for a stage of the goal."""
        self.observer.until(
            lambda: self.feedback and self.feedback[-1].stage == stage and also(), stage
        )

    def set(self, **values: object) -> None:
        for result in self.observer.set_on(self.process.name, **values):
            assert result.successful, result.reason


@pytest.fixture(scope="module")
def robot(observer: Observer, simulated_bags: Path) -> Iterator[KinematicRobot]:
    robot = KinematicRobot(observer.node, "arm", simulated_bags / "bag-1.mcap")
    yield robot
    robot.close()


@pytest.fixture(scope="module")
def shared(
    observer: Observer, robot: KinematicRobot, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Collector]:
    with ExitStack() as stack:
        folder = tmp_path_factory.mktemp("collector")
        process = start_node(
            "collector",
            folder,
            configuration=ARM2,
            controller="arm",
            motion="random",
            approach_speed=0.5,
            speed_scale=0.5,
            tracking_error=LIMIT,
            **PATIENT,
        )
        stack.callback(process.end)
        yield Collector(observer, process)


@pytest.fixture
def collector(shared: Collector, robot: KinematicRobot) -> Collector:
    robot.reset()
    shared.set(allow_motion=True, **PATIENT)
    return shared


def require_rest(robot: KinematicRobot, observer: Observer, before: int = 0) -> None:
    """The robot was stopped, by a trajectory after so many, within the allowed accelerations."""
    observer.until(lambda: len(robot.received) > before and not robot.moving, "rest")
    times, _, velocities = robot.received[-1]
    assert not velocities[-1].any()
    assert times[-1] < STOPPED


def test_goal_is_refused_unless_motion_is_allowed(collector, robot) -> None:
    collector.set(allow_motion=False)
    answer = collector.result(collector.send())
    assert answer.status == GoalStatus.STATUS_ABORTED
    assert "allow_motion" in answer.result.message
    assert robot.received == []


@pytest.mark.parametrize(
    ("request_", "words"),
    [
        ({"duration": -1.0}, "duration: -1.0 is not a number from 0 on"),
        ({"duration": 0.5}, "duration 0.5: 1 to 1000 s are possible"),
        ({"speed_scale": 1.5}, "speed_scale: 1.5 is more than 1"),
        ({"timeout": float("nan")}, "timeout: nan is not a number from 0 on"),
        ({"estimator": "best"}, "neither idim-iv nor idim-ls"),
        ({"identify": True}, "no /identifier/identify_bags: start the identifier"),
    ],
)
def test_bad_request_is_one_line_and_nothing_moves(collector, robot, request_, words: str) -> None:
    answer = collector.collect(**request_)
    assert not answer.success
    assert words in answer.message
    assert robot.received == []


def test_robot_is_led_to_the_start_then_slowly_then_at_full_speed_and_only_that_is_recorded(
    collector, robot
) -> None:
    here = robot.position.copy()
    answer = collector.collect(seed=3)
    assert answer.success, answer.message
    (approach, _, _), (slow, slow_places, _), (full, places, _) = robot.received
    assert np.allclose(robot.received[0][1][0], here, atol=1e-9)
    assert np.allclose(robot.received[0][1][-1], places[0], atol=1e-9)
    assert approach[-1] > 0.4
    assert slow[-1] == pytest.approx(2.0 * full[-1])
    assert np.allclose(slow_places, places)
    assert full[-1] == pytest.approx(1.0)
    assert robot.recorder == ["start", "stop"]
    assert (answer.bag, answer.usable) == ("bag-1.mcap", True)
    assert any("joint_1: moves over" in finding for finding in answer.findings)
    assert answer.message == "bag-1.mcap: 1 s recorded, usable"
    stages = list(dict.fromkeys(item.stage for item in collector.feedback))
    wanted = ["planning", "moving to the start", "slow pass", "recording", "checking"]
    assert [stage for stage in stages if stage in wanted] == wanted
    shares = [item.progress for item in collector.feedback]
    assert shares == sorted(shares)
    assert max(item.tracking_error for item in collector.feedback) < LIMIT


def test_cancelled_goal_brings_the_robot_to_rest_within_its_accelerations(
    collector, robot, observer
) -> None:
    collector.set(slow_speed=1.0)
    goal = collector.send(duration=2.0, speed_scale=1.0)
    feedback = collector.feedback
    assert collector.collect().message == "busy: another goal moves the robot"
    collector.feedback = feedback
    collector.until("recording", lambda: robot.moving and len(robot.received) == 3)
    before = len(robot.received)
    observer.until(lambda: np.abs(robot.motion(0.0) - robot.position).max() > 0.1, "speed")
    observer.wait(goal.cancel_goal_async())
    require_rest(robot, observer, before)
    answer = collector.result(goal)
    assert answer.status == GoalStatus.STATUS_CANCELED
    assert answer.result.message == "stopped in recording: cancelled"
    assert robot.recorder == ["start", "abort"]
    assert answer.result.bag == "bag-1.mcap"
    times, places, velocities = robot.received[-1]
    configuration = load_configuration(ARM2)
    allowed = motion_limits(load_model(configuration), configuration).acceleration
    assert np.all(np.abs(np.diff(velocities, axis=0) / np.diff(times)[:, None]) <= 1.01 * allowed)
    assert np.abs(places[0] - places[-1]).max() < 0.5


def test_robot_that_is_held_up_is_stopped_where_it_is(collector, robot, observer) -> None:
    robot.blocked = (robot.position[0] - 0.05, robot.position[0] + 0.05)
    answer = collector.collect(duration=1.5, speed_scale=1.0)
    assert not answer.success
    assert answer.message.startswith("stopped in ")
    assert "joint_1 is 0.1" in answer.message
    assert f"more than tracking_error {LIMIT:g}" in answer.message
    _, places, _ = robot.received[-1]
    assert robot.blocked[0] - 1e-6 <= places[0][0] <= robot.blocked[1] + 1e-6
    require_rest(robot, observer)


def test_robot_that_ignores_its_trajectory_is_noticed(collector, robot) -> None:
    robot.obeys = False
    collector.set(start_delay=1.0)
    answer = collector.collect(seed=2)
    assert not answer.success
    assert "the robot does not move: does its controller run?" in answer.message
    assert robot.recorder == []
    _, places, velocities = robot.received[-1]
    assert np.allclose(places, robot.position, atol=1e-6)
    assert not velocities.any()


def test_robot_whose_joint_states_end_is_stopped(collector, robot, observer) -> None:
    collector.set(stale_after=STALE)
    goal = collector.send(duration=4.0)
    collector.until("slow pass", lambda: robot.moving)
    before = len(robot.received)
    robot.publishes = False
    require_rest(robot, observer, before)
    robot.publishes = True
    silent = re.fullmatch(
        r"stopped in slow pass: no joint states on /joint_states for (\S+) s",
        collector.result(goal).result.message,
    )
    assert float(silent[1]) >= STALE
    assert robot.recorder == []


def test_robot_is_stopped_when_somebody_else_stops_the_recorder(collector, robot, observer) -> None:
    collector.set(slow_speed=1.0)
    goal = collector.send(duration=1.5)
    collector.until("recording")
    robot.report()
    robot.state = RecorderStatus.IDLE
    answer = collector.result(goal)
    assert answer.result.message.startswith("stopped in recording: ")
    assert answer.result.message.endswith("somebody stopped it")
    require_rest(robot, observer)


def test_nothing_moves_while_the_recorder_writes_another_bag(collector, robot, observer) -> None:
    robot.state = RecorderStatus.RECORDING
    robot.report()
    collector.set(allow_motion=True)  # answered after the report was heard
    answer = collector.collect()
    assert answer.message == "the recorder writes bag-1.mcap already: call /recorder/stop"
    assert robot.received == []
    robot.state = RecorderStatus.IDLE
    robot.report()
    collector.set(allow_motion=True)


def test_nothing_moves_while_two_collectors_have_one_name(collector, robot, observer) -> None:
    topic = f"/{collector.process.name}/collect/_action/status"
    second = observer.node.create_publisher(GoalStatusArray, topic, 1)
    try:
        observer.until(lambda: observer.node.count_publishers(topic) == 2, "the second")
        collector.set(allow_motion=True)  # by a client that the collector hears of after that
        assert collector.collect().message.startswith("several collectors would obey a goal on /")
        assert robot.received == []
    finally:
        observer.node.destroy_publisher(second)


def test_recorder_that_is_silent_is_gone(observer) -> None:
    now = 100.0
    recorder = RecorderNeighbour(observer.node, lambda: now)
    for seconds in (0.0, 1.0):
        now += seconds
        recorder._reported(RecorderStatus(state=RecorderStatus.RECORDING, bag="bags/bag-1.mcap"))
    now += 4.9
    assert recorder.trouble() == ""
    now += 1.1
    assert "silent for 6 s" in recorder.trouble()
    assert "bag-1.mcap" in recorder.trouble()
    recorder._reported(RecorderStatus(state=RecorderStatus.IDLE))
    assert recorder.trouble().endswith("somebody stopped it")


def test_robot_is_stopped_when_motion_is_no_longer_allowed(collector, robot, observer) -> None:
    goal = collector.send(duration=4.0)
    collector.until("slow pass", lambda: robot.moving)
    collector.set(allow_motion=False)
    answer = collector.result(goal).result
    assert answer.message == "stopped in slow pass: allow_motion was set to false"
    require_rest(robot, observer)


def test_robot_is_stopped_at_the_timeout(collector, robot, observer) -> None:
    answer = collector.collect(duration=4.0, timeout=3.0)
    assert answer.message.endswith("not finished within 3 s")
    if robot.received:  # else it has not come that far in time
        require_rest(robot, observer)


def test_robot_is_stopped_when_who_asked_is_gone(collector, robot, observer) -> None:
    collector.send(duration=6.0)
    collector.until("slow pass", lambda: robot.moving)
    before = len(robot.received)
    collector.action.destroy()
    require_rest(robot, observer, before)
    collector.connect()
    gone = "stopped in slow pass: who asked is gone"
    observer.until(lambda: gone in collector.process.errors.read_text(), "the reason")


def test_robot_is_stopped_when_the_node_is_interrupted(collector, robot, observer) -> None:
    """The last of the file: it ends the node that they share."""
    process = collector.process
    goal = collector.send(duration=4.0)
    collector.until("slow pass", lambda: robot.moving)
    before = len(robot.received)
    future = goal.get_result_async()
    process.process.send_signal(2)
    require_rest(robot, observer, before)
    message = observer.wait(future).result.message
    assert message == "stopped in slow pass: the collector was shut down"
    observer.until(lambda: process.process.poll() is not None, "its end")
    assert process.process.poll() == 0
    assert "Traceback" not in process.errors.read_text()
