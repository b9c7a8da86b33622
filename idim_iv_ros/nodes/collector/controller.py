"""The two ways to have a trajectory followed: a topic, and the action of ros2_control."""

from collections.abc import Callable
from typing import Any, Protocol

from builtin_interfaces.msg import Duration
from rclpy.action.client import ActionClient
from rclpy.node import Node
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from idim_iv_ros.errors import UsageError
from idim_iv_ros.excitation import Trajectory
from idim_iv_ros.nodes.collector.settings import ACTION, TOPIC

_SECOND = 1_000_000_000
_CODES = (
    "INVALID_GOAL",
    "INVALID_JOINTS",
    "OLD_HEADER_TIMESTAMP",
    "PATH_TOLERANCE_VIOLATED",
    "GOAL_TOLERANCE_VIOLATED",
)


class Controller(Protocol):
    """What follows trajectories."""

    def missing(self) -> str:
        """Why it cannot be used now; empty if it can."""

    def follow(self, motion: Trajectory, point_rate: float) -> None:
        """Ask it to follow a motion that begins where the robot is."""

    def halt(self, stop: Trajectory) -> None:
        """Have it come to rest, if it can along `stop`."""

    def failure(self) -> str:
        """Why it does not follow, as it says itself; empty if it says nothing."""


def trajectory_message(motion: Trajectory, point_rate: float) -> Any:
    """Return every k-th sample and the last one, to be begun at once.

    Parameters
    ----------
    motion
    point_rate
        Points per second.
    """
    samples = len(motion.position)
    kept = list(range(0, samples - 1, max(1, round(motion.rate / point_rate))))
    points = []
    for sample in [*kept, samples - 1]:
        whole, rest = divmod(round(sample / motion.rate * _SECOND), _SECOND)
        points.append(
            JointTrajectoryPoint(
                positions=motion.position[sample].tolist(),
                velocities=motion.velocity[sample].tolist(),
                accelerations=motion.acceleration[sample].tolist(),
                time_from_start=Duration(sec=whole, nanosec=rest),
            )
        )
    return JointTrajectory(joint_names=list(motion.joints), points=points)


class TopicController:
    """Publishes on ``joint_trajectory`` of the controller, which does not answer."""

    def __init__(self, node: Node, name: str) -> None:
        self._publisher = node.create_publisher(JointTrajectory, f"{name}/joint_trajectory", 1)

    def missing(self) -> str:
        """Why it cannot be used now; empty if it can."""
        if self._publisher.get_subscription_count():
            return ""
        return f"nobody listens on {self._publisher.topic_name}: is the controller running?"

    def follow(self, motion: Trajectory, point_rate: float) -> None:
        """Publish the motion."""
        self._publisher.publish(trajectory_message(motion, point_rate))

    def halt(self, stop: Trajectory) -> None:
        """Publish a motion that comes to rest; the controller drops the one under way."""
        self._publisher.publish(trajectory_message(stop, stop.rate))

    def failure(self) -> str:
        """Nothing: a topic does not answer."""
        return ""


class ActionController:
    """Sends goals to ``follow_joint_trajectory`` of the controller."""

    def __init__(self, node: Node, name: str, kind: Any) -> None:
        self._kind = kind
        self._name = f"{name}/follow_joint_trajectory"
        self._client = ActionClient(node, kind, self._name)
        self._goal: Any = None
        self._number = 0
        self._failure = ""

    def missing(self) -> str:
        """Why it cannot be used now; empty if it can."""
        if self._client.server_is_ready():
            return ""
        return f"no action server {self._name}: is the controller running?"

    def follow(self, motion: Trajectory, point_rate: float) -> None:
        """Send the motion as a goal."""
        self._goal, self._failure = None, ""
        self._number += 1
        goal = self._kind.Goal(trajectory=trajectory_message(motion, point_rate))
        answered = self._client.send_goal_async(goal)
        answered.add_done_callback(self._of_this_goal(self._accepted))

    def halt(self, stop: Trajectory) -> None:
        """Cancel the goal: the controller holds where it is."""
        self._number += 1  # that it was cancelled is no failure
        if self._goal is not None:
            self._goal.cancel_goal_async()

    def failure(self) -> str:
        """Why the goal was refused or ended, as the controller says it."""
        return self._failure

    def _of_this_goal(self, callback: Callable[[Any], None]) -> Callable[[Any], None]:
        number = self._number

        def call(future: Any) -> None:
            if number == self._number:
                callback(future.result())
            elif callback == self._accepted and future.result().accepted:
                future.result().cancel_goal_async()  # halted before the controller had answered

        return call

    def _accepted(self, goal: Any) -> None:
        if not goal.accepted:
            self._failure = "the controller refuses the trajectory"
            return
        self._goal = goal
        goal.get_result_async().add_done_callback(self._of_this_goal(self._ended))

    def _ended(self, answer: Any) -> None:
        code = answer.result.error_code
        if code != self._kind.Result.SUCCESSFUL:
            names = {getattr(self._kind.Result, name): name for name in _CODES}
            words = " ".join(str(answer.result.error_string).split())
            self._failure = (
                f"the controller ends the motion: {names.get(code, code)} {words}".strip()
            )


def make_controller(node: Node, name: str, interface: str) -> Controller:
    """Return the way to a controller: the action where it is wanted and control_msgs is installed.

    Raises
    ------
    UsageError
        The action is wanted and control_msgs is not installed, or the name is none of ROS.
    """
    try:
        node.resolve_topic_name(f"{name}/joint_trajectory")
    except Exception as error:  # rclpy has one class for each thing that can be wrong
        raise UsageError(
            f"parameter controller: {name!r} is no name of ROS: letters, digits and _, no digit "
            "first, parts separated by /"
        ) from error
    if interface != TOPIC:
        try:
            from control_msgs.action import FollowJointTrajectory
        except ImportError as error:
            if interface == ACTION:
                raise UsageError(
                    "interface: control_msgs is not installed: set it to topic, or install "
                    "ros-jazzy-control-msgs"
                ) from error
        else:
            action = ActionController(node, name, FollowJointTrajectory)
            if interface == ACTION:
                return action
            return _Either(action, TopicController(node, name))
    return TopicController(node, name)


class _Either:
    """The action if there is a server when a motion begins, else the topic."""

    def __init__(self, action: ActionController, topic: TopicController) -> None:
        self._action, self._topic = action, topic
        self._used: Controller = topic

    def missing(self) -> str:
        """Why neither can be used now; empty if one can."""
        self._used = self._topic if self._action.missing() else self._action
        return self._used.missing()

    def follow(self, motion: Trajectory, point_rate: float) -> None:
        """Ask the one that was found."""
        self._used.follow(motion, point_rate)

    def halt(self, stop: Trajectory) -> None:
        """Have the one that was found stop."""
        self._used.halt(stop)

    def failure(self) -> str:
        """What the one that was found says."""
        return self._used.failure()
