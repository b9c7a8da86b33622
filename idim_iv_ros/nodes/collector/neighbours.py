"""The nodes that the collector needs: a ros2_control controller, the recorder, the identifier."""

import time
from collections.abc import Callable
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any

from builtin_interfaces.msg import Duration
from rclpy.action.client import ActionClient
from rclpy.node import Node
from std_srvs.srv import Trigger
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from idim_iv_interfaces.action import Identify
from idim_iv_interfaces.msg import BagClosed, RecorderStatus
from idim_iv_ros.errors import UsageError
from idim_iv_ros.excitation.trajectory import Trajectory
from idim_iv_ros.nodes.parameters import NAMES
from idim_iv_ros.nodes.settings import ACTION, TOPIC

LOOK = 0.02  # s between two looks at the robot

_CODES = (
    *("INVALID_GOAL", "INVALID_JOINTS", "OLD_HEADER_TIMESTAMP"),
    *("PATH_TOLERANCE_VIOLATED", "GOAL_TOLERANCE_VIOLATED"),
)
_ANSWER = 15.0  # s to wait for an answer; the recorder waits ten for a disk
_SILENT = 5.0  # s, or three periods of its status, after which the recorder is gone
_PERIODS = 3
_WRITING = {RecorderStatus.RECORDING, RecorderStatus.PAUSED, RecorderStatus.WAITING_FOR_CLOCK}

Tick = Callable[[], None]  # sleeps a little; raises when the collection must end


def wait_until(condition: Callable[[], bool], seconds: float, what: str, tick: Tick) -> None:
    """Tick until a condition holds; a UsageError says that `what` did not come within `seconds`."""
    until = time.monotonic() + seconds
    while not condition():
        tick()
        if time.monotonic() > until:
            raise UsageError(f"{what} did not come within {seconds:g} s")


def trajectory_message(motion: Trajectory, point_rate: float) -> Any:
    """Return a JointTrajectory of `point_rate` points a second (Hz), the last sample included."""
    points = []
    for nanoseconds, values in motion.points(point_rate):
        whole, rest = divmod(nanoseconds, 1_000_000_000)
        place = dict(zip(("positions", "velocities", "accelerations"), values, strict=True))
        due = Duration(sec=whole, nanosec=rest)
        points.append(JointTrajectoryPoint(**place, time_from_start=due))
    return JointTrajectory(joint_names=list(motion.joints), points=points)


class Controller:
    """A ros2_control controller that follows trajectories.

    `interface` ``action`` uses ``follow_joint_trajectory``, ``topic`` ``joint_trajectory``, which
    reports no failure; ``auto`` the action if its server was ready at the last call of `missing`.
    Raises UsageError: control_msgs, needed for the action, is not installed, or `name` is invalid.
    """

    def __init__(self, node: Node, name: str, interface: str) -> None:
        try:
            node.resolve_topic_name(f"{name}/joint_trajectory")
        except Exception as error:  # rclpy has one class for each thing that can be wrong
            raise UsageError(
                f"parameter controller: {name!r} is no name of ROS: {NAMES}"
            ) from error
        self._kind: Any = None
        if interface != TOPIC:
            try:
                self._kind = import_module("control_msgs.action").FollowJointTrajectory
            except ImportError as error:
                if interface == ACTION:
                    raise UsageError(
                        "interface: control_msgs is not installed: set it to topic, or install "
                        "ros-jazzy-control-msgs"
                    ) from error
        self._action = f"{name}/follow_joint_trajectory"
        self._client: Any = self._kind and ActionClient(node, self._kind, self._action)
        self._publisher: Any = None
        if interface != ACTION:
            self._publisher = node.create_publisher(JointTrajectory, f"{name}/joint_trajectory", 1)
        self._by_action = interface == ACTION
        self._goal: Any = None
        self._goals_sent = 0
        self._failure = ""

    def missing(self) -> str:
        """Return why the controller cannot be used now; empty if it can."""
        self._by_action = self._client is not None and self._client.server_is_ready()
        if self._by_action:
            return ""
        if self._publisher is None:
            return f"no action server {self._action}: is the controller running?"
        if self._publisher.get_subscription_count():
            return ""
        return f"nobody listens on {self._publisher.topic_name}: is the controller running?"

    def follow(self, motion: Trajectory, point_rate: float) -> None:
        """Send the controller a motion that begins where the robot is."""
        message = trajectory_message(motion, point_rate)
        if not self._by_action:
            self._publisher.publish(message)
            return
        self._goal, self._failure = None, ""
        self._goals_sent += 1
        number = self._goals_sent  # what comes of an earlier goal is no matter

        def accepted(future: Any) -> None:
            goal = future.result()
            if number != self._goals_sent:  # halted before the controller had answered
                if goal.accepted:
                    goal.cancel_goal_async()
            elif not goal.accepted:
                self._failure = "the controller refuses the trajectory"
            else:
                self._goal = goal
                goal.get_result_async().add_done_callback(ended)

        def ended(future: Any) -> None:
            result, kind = future.result().result, self._kind.Result
            if number == self._goals_sent and result.error_code != kind.SUCCESSFUL:
                names = {getattr(kind, name): name for name in _CODES}
                code = names.get(result.error_code, str(result.error_code))
                words = " ".join([code, *result.error_string.split()])
                self._failure = f"the controller ends the motion: {words}"

        sent = self._client.send_goal_async(self._kind.Goal(trajectory=message))
        sent.add_done_callback(accepted)

    def halt(self, stop: Trajectory) -> None:
        """Bring the robot to rest: cancel the goal of the action, or send the trajectory `stop`."""
        if not self._by_action:
            self._publisher.publish(trajectory_message(stop, stop.rate))
            return
        self._goals_sent += 1  # that the goal was cancelled is no failure
        if self._goal is not None:
            self._goal.cancel_goal_async()

    def failure(self) -> str:
        """Return why the controller refused or ended the goal; empty if it did neither."""
        return self._failure if self._by_action else ""


class RecorderNeighbour:
    """Services ``start``, ``stop`` and ``abort`` of the node ``recorder``, and its status.

    A killed recorder stays in the list of services for about 20 s; that its status stops is noticed
    earlier, by the monotonic `clock`, s.
    """

    def __init__(self, node: Node, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        names = ("start", "stop", "abort")
        self._clients = {name: node.create_client(Trigger, f"recorder/{name}") for name in names}
        self._closed: list[str] = []
        self._status: RecorderStatus | None = None
        self._heard_at, self._period = 0.0, 0.0
        self._records = False
        node.create_subscription(BagClosed, "recorder/bag_closed", self._bag_closed, 10)
        node.create_subscription(RecorderStatus, "recorder/status", self._reported, 10)

    def missing(self) -> str:
        """Return why the recorder cannot start a bag now; empty if it can."""
        for client in self._clients.values():
            if not client.service_is_ready():
                return f"no {client.service_name}: start the recorder"
        status, stop = self._status, self._clients["stop"].service_name
        if status is None:
            return ""
        writes = f"the recorder writes {Path(status.bag).name} already: call {stop}"
        return self._silence() or (writes if status.state in _WRITING else "")

    def trouble(self) -> str:
        """Return why the bag that is recorded is incomplete; empty without a reported fault."""
        status = self._status
        if status is None:
            return ""
        if silent := self._silence():
            return f"{silent}; {Path(status.bag).name or 'the bag'} holds what was written before"
        if status.state == RecorderStatus.WAITING_FOR_CLOCK:
            return f"the recorder does not record yet: {status.fault}"
        if self._records and status.state != RecorderStatus.RECORDING:
            return f"the recorder does not record any more: {status.fault or 'somebody stopped it'}"
        return ""

    def _silence(self) -> str:
        silent = self._clock() - self._heard_at
        if silent > max(_SILENT, _PERIODS * self._period):
            return f"the recorder has been silent for {silent:.0f} s: is it running?"
        return ""

    def _reported(self, message: RecorderStatus) -> None:
        now = self._clock()
        if self._status is not None:
            self._period = now - self._heard_at
        self._status, self._heard_at = message, now
        # A status from before the start may arrive after it.
        self._records = self._records or message.state == RecorderStatus.RECORDING

    def start(self, tick: Tick) -> None:
        """Have the recorder open a bag; a UsageError says why it refuses."""
        self._closed.clear()
        self._records = False
        self._call_service("start", tick)

    def stop(self, *, aborted: bool = False) -> Path:
        """Have the bag closed or aborted, and return its folder; a UsageError says why not."""
        sleep = partial(time.sleep, LOOK)
        self._call_service("abort" if aborted else "stop", sleep)
        self._status = None  # that it records is no longer true
        wait_until(lambda: bool(self._closed), _ANSWER, "the recorder's word on the bag", sleep)
        return Path(self._closed[-1])

    def _bag_closed(self, message: Any) -> None:
        self._closed.append(message.bag)

    def _call_service(self, what: str, tick: Tick) -> None:
        client = self._clients[what]
        future: Any = client.call_async(Trigger.Request())
        wait_until(future.done, _ANSWER, f"an answer of {client.service_name}", tick)
        if not future.result().success:
            raise UsageError(f"{client.service_name}: {future.result().message}")


class IdentifierNeighbour:
    """Client of the action ``identifier/identify_bags``."""

    def __init__(self, node: Node) -> None:
        self._client = ActionClient(node, Identify, "identifier/identify_bags")
        self._name = node.resolve_service_name("identifier/identify_bags")

    def missing(self) -> str:
        """Return why the identifier cannot be used now; empty if it can."""
        if self._client.server_is_ready():
            return ""
        return f"no {self._name}: start the identifier, or leave identify out"

    def identify(
        self, bag: Path, estimator: str, say: Callable[[str, float], None], tick: Tick
    ) -> Any:
        """Have a bag identified and return the result message; a UsageError says why it is not.

        `say` takes the stage and the share done; where `tick` raises, the goal is cancelled.
        """
        if missing := self.missing():
            raise UsageError(missing)
        goal = Identify.Goal(bags=[str(bag)], estimator=estimator)
        sent = self._client.send_goal_async(
            goal, lambda message: say(message.feedback.stage, message.feedback.progress)
        )
        wait_until(sent.done, _ANSWER, f"an answer of {self._name}", tick)
        result = sent.result().get_result_async()
        try:
            while not result.done():
                if self.missing():
                    raise UsageError("the identifier is gone")
                tick()
        except Exception:
            sent.result().cancel_goal_async()
            raise
        return result.result().result
