"""The node `collector`: moves a robot, has the motion recorded, checked and identified."""

import math
import time
from collections.abc import Mapping, Sequence
from functools import partial

from rclpy.action.server import ServerGoalHandle
from rclpy.node import Node

from idim_iv_interfaces.action import Collect
from idim_iv_ros.errors import IdimError, UsageError
from idim_iv_ros.nodes.collector.collection import Collection, HeardRobot
from idim_iv_ros.nodes.collector.neighbours import (
    Controller,
    IdentifierNeighbour,
    RecorderNeighbour,
)
from idim_iv_ros.nodes.entry import in_thread, run_node
from idim_iv_ros.nodes.identifier.job_queue import ESTIMATORS
from idim_iv_ros.nodes.identifier.request_server import DeferredActionServer, send_last_answers
from idim_iv_ros.nodes.parameters import NodeProgram
from idim_iv_ros.nodes.settings import CollectorSettings

_BETWEEN_LOOKS, _ABSENCES = 0.4, 2  # s between two looks for clients; looks that must find none

ABOUT = """collector: move the robot along a motion that shows its parameters, record it, check the
recording, identify.

  ros2 run idim_iv_ros collector --ros-args -p configuration:=ROBOT.yaml \\
    -p controller:=joint_trajectory_controller -p allow_motion:=true
  ros2 action send_goal --feedback /collector/collect idim_iv_interfaces/action/Collect \\
    "{identify: true}"

IT MOVES THE ROBOT, and knows nothing of people and obstacles: docs/ros.md, "Moving the robot".
It needs the nodes recorder and identifier. Parameters: ros2 param describe /collector NAME."""


class Collector(NodeProgram[CollectorSettings]):
    """The node `collector`: an action server that runs one `Collection` at a time."""

    def __init__(self, arguments: Sequence[str] = ()) -> None:
        super().__init__(Node("collector"), CollectorSettings, arguments)
        node = self.node
        self._controller = Controller(node, self._settings.controller, self._settings.interface)
        self._recorder = RecorderNeighbour(node)
        self._identifier = IdentifierNeighbour(node)
        self._robot: HeardRobot | None = None
        self._load_robot()
        self._goal: ServerGoalHandle | None = None
        self._collection: Collection | None = None
        self._actions = DeferredActionServer(
            node, Collect, "~/collect", self._start_goal, self._cancel
        )
        self._name = node.resolve_service_name("~/collect")
        self._clients_seen, self._absences, self._looked = False, 0, -math.inf
        self._follow_changes()
        robot = self._settings.configuration or "no robot configured"
        may = "may" if self._settings.allow_motion else "must not"
        node.get_logger().info(
            f"ready: {robot}; {may} move it by {self._settings.controller} (allow_motion)"
        )

    def close(self) -> None:
        """Stop the robot if it moves, answer the goal, and end the node."""
        if self._collection is not None:
            self._collection.cancel("the collector was shut down")
        while self._goal is not None and self.node.executor is not None:
            self.node.executor.spin_once(timeout_sec=0.05)
        send_last_answers(self.node)
        self._actions.destroy()  # type: ignore[no-untyped-call]
        super().close()

    def _load_robot(self) -> None:
        before, self._robot = self._robot, None
        if before is not None:
            before.close()
        if self._settings.configuration:
            self._robot = HeardRobot(self.node, self._settings.configuration)

    def _clients_gone(self) -> bool:
        """Return whether clients were seen before, and none in the last two looks.

        A server does not learn who called: only without any client it is certain that nobody waits
        for an answer. A killed client is listed until its lease in the middleware ends,
        usually 20 s.
        """
        if time.monotonic() - self._looked > _BETWEEN_LOOKS:
            self._looked = time.monotonic()
            if self.node.count_clients(f"{self._name}/_action/get_result"):
                self._clients_seen, self._absences = True, 0
            elif self._clients_seen:
                self._absences += 1
        return self._absences >= _ABSENCES

    def _start_goal(self, goal: ServerGoalHandle) -> None:
        try:
            request = self._complete_goal(goal.request)
            collection = Collection(
                request,
                self._movable_robot(),
                self._controller,
                self._recorder,
                self._identifier,
                settings=lambda: self._settings,
                gone=self._clients_gone,
                say=self._say,
            )
        except IdimError as error:
            self.node.get_logger().warning(f"refused: {error}")
            self._actions.finish(goal, Collect.Result(success=False, message=str(error)))
            return
        self._goal, self._collection = goal, collection
        goal.execute()
        executor = self.node.executor
        assert executor is not None
        in_thread(collection.run, "collection").add_done_callback(
            lambda done: executor.create_task(self._finish_goal, goal, done.result())
        )

    def _complete_goal(self, request: Collect.Goal) -> Collect.Goal:
        """Return a goal with the node's parameters in place of zeros; a UsageError refuses it."""
        settings = self._settings
        if not settings.allow_motion:
            raise UsageError(
                "the robot must not be moved: set the parameter allow_motion to true once nobody "
                "is near it and its way is free"
            )
        if self._goal is not None:
            raise UsageError("busy: another goal moves the robot")
        if self.node.count_publishers(f"{self._name}/_action/status") > 1:
            raise UsageError(
                f"several collectors would obey a goal on {self._name}: end all but one, or give "
                "each robot a namespace"
            )
        for name in ("duration", "speed_scale", "timeout"):
            value = getattr(request, name)
            if not math.isfinite(value) or value < 0.0:
                raise UsageError(f"{name}: {value} is not a number from 0 on")
        estimator = request.estimator
        if estimator not in ("", *ESTIMATORS):
            raise UsageError(f"estimator {estimator!r} is neither {' nor '.join(ESTIMATORS)}")
        if request.speed_scale > 1.0:
            raise UsageError(f"speed_scale: {request.speed_scale:g} is more than 1")
        if not request.seed >= 0:
            raise UsageError(f"seed: {request.seed} is negative")
        return Collect.Goal(
            duration=request.duration or settings.motion_duration,
            speed_scale=request.speed_scale or settings.speed_scale,
            seed=request.seed or settings.motion_seed,
            identify=request.identify,
            estimator=estimator,
            timeout=min(request.timeout or math.inf, settings.job_timeout),
        )

    def _movable_robot(self) -> HeardRobot:
        if self._robot is None:
            raise UsageError("no robot is configured: set the parameter configuration")
        robot = self._robot.configuration.robot
        if robot.motor_to_joint is not None or any(robot.position_offset or ()):
            raise UsageError(
                "robot.motor_to_joint, robot.position_offset: the joint states are not the "
                "positions that the controller is asked for; move such a robot yourself"
            )
        return self._robot

    def _say(self, stage: str, share: float, error: float, joint: str) -> None:
        if (goal := self._goal) is not None:
            message = {"stage": stage, "progress": share}
            message |= {"tracking_error": error, "tracking_joint": joint}
            goal.publish_feedback(Collect.Feedback(**message))

    def _cancel(self, goal: ServerGoalHandle) -> None:
        if self._collection is not None and goal is self._goal:
            self._collection.cancel("cancelled")

    def _finish_goal(self, goal: ServerGoalHandle, result: Collect.Result) -> None:
        self._goal = self._collection = None
        log = self.node.get_logger()
        if result.success:
            log.info(result.message)
        else:
            log.error(result.message)
        self._actions.finish(goal, result)

    def _refuse(self, given: Mapping[str, object]) -> str:
        if "configuration" in given and self._goal is not None:
            return "configuration: a goal is under way; cancel it first"
        return ""

    def _apply(self, given: set[str]) -> None:
        if "configuration" in given:
            self._load_robot()


run = partial(run_node, "collector", Collector, ABOUT)
