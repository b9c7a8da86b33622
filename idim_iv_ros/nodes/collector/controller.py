"""Trajectories for a controller of ros2_control: by its action or by its topic."""

from collections.abc import Callable
from typing import Any

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


class Controller:
    """A controller of ros2_control that follows trajectories.

    Its action ``follow_joint_trajectory`` is used where a server is there when `missing` is called,
    else its topic ``joint_trajectory``, on which it does not answer.

    Parameters
    ----------
    node : Node
    name : str
        Name of the controller, resolved in the namespace of the node.
    interface : str
        ``topic`` or ``action`` for that one only, ``auto`` for either.

    Raises
    ------
    UsageError
        The action is wanted and control_msgs is not installed, or the name is none of ROS.
    """

    def __init__(self, node: Node, name: str, interface: str) -> None:
        try:
            node.resolve_topic_name(f"{name}/joint_trajectory")
        except Exception as error:  # rclpy has one class for each thing that can be wrong
            raise UsageError(
                f"parameter controller: {name!r} is no name of ROS: letters, digits and _, no "
                "digit first, parts separated by /"
            ) from error
        self._kind: Any = None if interface == TOPIC else _action_type(required=interface == ACTION)
        self._action = f"{name}/follow_joint_trajectory"
        self._client = None if self._kind is None else ActionClient(node, self._kind, self._action)
        self._publisher = (
            None
            if interface == ACTION
            else node.create_publisher(JointTrajectory, f"{name}/joint_trajectory", 1)
        )
        self._by_action = interface == ACTION
        self._goal: Any = None
        self._goals_sent = 0
        self._failure = ""

    def missing(self) -> str:
        """Why the controller cannot be used now; empty if it can."""
        self._by_action = self._client is not None and self._client.server_is_ready()
        if self._by_action:
            return ""
        if self._publisher is None:
            return f"no action server {self._action}: is the controller running?"
        if self._publisher.get_subscription_count():
            return ""
        return f"nobody listens on {self._publisher.topic_name}: is the controller running?"

    def follow(self, motion: Trajectory, point_rate: float) -> None:
        """Ask the controller to follow a motion that begins where the robot is.

        Parameters
        ----------
        motion
        point_rate
            Points of the trajectory per second.
        """
        message = trajectory_message(motion, point_rate)
        if not self._by_action:
            assert self._publisher is not None
            self._publisher.publish(message)
            return
        assert self._client is not None
        self._goal, self._failure = None, ""
        self._goals_sent += 1
        answer = self._client.send_goal_async(self._kind.Goal(trajectory=message))
        answer.add_done_callback(self._of_this_goal(self._accepted))

    def halt(self, stop: Trajectory) -> None:
        """Bring the robot to rest: a controller whose goal is cancelled holds where it is.

        Parameters
        ----------
        stop
            Motion that comes to rest, for a controller that is used by its topic.
        """
        if not self._by_action:
            assert self._publisher is not None
            self._publisher.publish(trajectory_message(stop, stop.rate))
            return
        self._goals_sent += 1  # that the goal was cancelled is no failure
        if self._goal is not None:
            self._goal.cancel_goal_async()

    def failure(self) -> str:
        """Why the goal was refused or ended, as the controller says it; empty without a reason."""
        return self._failure if self._by_action else ""

    def _of_this_goal(self, callback: Callable[[Any], None]) -> Callable[[Any], None]:
        """Return a callback of a future that does nothing once another goal was sent."""
        number = self._goals_sent

        def call(future: Any) -> None:
            if number == self._goals_sent:
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


def _action_type(required: bool) -> Any:
    """Return FollowJointTrajectory; None where control_msgs is not installed."""
    try:
        from control_msgs.action import FollowJointTrajectory
    except ImportError as error:
        if required:
            raise UsageError(
                "interface: control_msgs is not installed: set it to topic, or install "
                "ros-jazzy-control-msgs"
            ) from error
        return None
    return FollowJointTrajectory
