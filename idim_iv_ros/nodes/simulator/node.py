"""The node `robot_simulator`: simulates a robot with given true parameters in real time."""

import contextlib
import json
import threading
import time
from collections.abc import Sequence
from concurrent.futures import Future
from functools import partial
from pathlib import Path

import numpy as np
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool, String
from std_srvs.srv import Trigger
from trajectory_msgs.msg import JointTrajectory

from idim_iv_ros.configuration import load_configuration
from idim_iv_ros.errors import IdimError, UsageError, one_line
from idim_iv_ros.excitation.excite import random_motion
from idim_iv_ros.excitation.trajectory import Trajectory, read_trajectory
from idim_iv_ros.nodes.entry import LATCHED, CannotGoOnError, in_thread, run_node, steady_timer
from idim_iv_ros.nodes.parameters import NodeProgram
from idim_iv_ros.nodes.settings import SimulatorSettings
from idim_iv_ros.nodes.simulator.playback import MotionSimulation, Playback, commanded
from idim_iv_ros.recording.request import ROBOT_DESCRIPTION
from idim_iv_ros.recording.writing.write import JointTopic
from idim_iv_ros.simulators.recording import simulated_robot

ABOUT = """robot_simulator: a simulated robot that publishes its joint states in real time.

  ros2 run idim_iv_ros robot_simulator --ros-args -p configuration:=ROBOT.yaml
  ros2 service call /robot_simulator/move std_srvs/srv/Trigger

~/move plays the CSV file of the parameter `trajectory`, or a random exciting motion; a
trajectory_msgs/JointTrajectory on ~/joint_trajectory is played too. ~/truth holds the true base
parameters as JSON, ~/moving whether a motion is planned or under way."""

_FASTEST = 1000.0  # Hz
_QUEUE = 1000
_LOOK = 0.1  # s between two looks at what the threads do
_PATIENCE = 2.0  # s; what was compiled before is there by then
_COMPILING = "the simulation is compiled, once on a new machine: a minute or two"
_LEAD = 0.3  # s in which the change to another motion is simulated; longer if that is not enough


class RobotSimulator(NodeProgram[SimulatorSettings]):
    """The node `robot_simulator`: topics and services around threads that publish and plan."""

    def __init__(self, arguments: Sequence[str] = ()) -> None:
        super().__init__(Node("robot_simulator"), SimulatorSettings, arguments)
        node = self.node
        configuration = load_configuration(Path(self._settings.configuration))
        period = configuration.controller.period
        rate = configuration.simulated_robot.rate or (1.0 / period if period else _FASTEST)
        if rate > _FASTEST + 1e-6:
            where = f"{configuration.source}: simulated_robot.rate"
            raise UsageError(f"{where}: {rate:g} Hz; at most {_FASTEST:g} Hz in real time")
        robot = simulated_robot(configuration)
        self._simulation = MotionSimulation(robot, float(rate))
        middle = 0.5 * (robot.robot.limits.lower + robot.robot.limits.upper)
        self._references = np.where(np.isfinite(middle), middle, 0.0)[None]
        texts = {ROBOT_DESCRIPTION: robot.description, "~/truth": json.dumps(robot.truth)}
        for name, text in texts.items():
            node.create_publisher(String, name, LATCHED).publish(String(data=text))
        self._playback: Playback | None = None
        self._planning = threading.Lock()
        self._problem = ""
        self._said: bool | None = None
        self._moving = node.create_publisher(Bool, "~/moving", LATCHED)
        node.create_subscription(JointTrajectory, "~/joint_trajectory", self._command, 1)
        node.create_service(Trigger, "~/move", self._move)
        steady_timer(node, _LOOK, self._report)
        self._follow_changes()
        self._begun, self._said_compiling = time.monotonic(), False
        self._rest = in_thread(self._prepare, "preparing")

    def close(self) -> None:
        """Stop publishing, and end the node."""
        if self._playback is not None:
            self._playback.end()
        super().close()

    def _prepare(self) -> list[JointTopic]:
        """Return the robot at rest as messages; compile what that and ~/move need."""
        with contextlib.suppress(IdimError):  # without joint limits there are no random motions
            self._random_motion(duration=1.0, seed=1)
        return self._from_rest(None)

    def _begin(self) -> Playback | None:
        """Publish once the simulation is compiled; return None before."""
        log, seconds = self.node.get_logger(), time.monotonic() - self._begun
        if not self._rest.done():
            if seconds > _PATIENCE and not self._said_compiling:
                self._said_compiling = True
                log.info(f"{_COMPILING}; joint states follow")
            return None
        try:
            topics = self._rest.result()
        except Exception as error:
            why = UsageError(f"cannot simulate: {one_line(error)}")
            raise CannotGoOnError(error if isinstance(error, IdimError) else why) from error
        publishers = {
            topic.name: self.node.create_publisher(JointState, topic.name, _QUEUE)
            for topic in topics
        }
        publish = {name: publisher.publish for name, publisher in publishers.items()}
        playback = Playback(topics, publish, self._now)
        playback.start()
        names = ", ".join(publisher.topic_name for publisher in publishers.values())
        move = f"{self.node.get_fully_qualified_name()}/move"
        log.info(f"ready after {seconds:.1f} s: publishes {names}; call {move} to move it")
        return playback

    def _command(self, message: JointTrajectory) -> None:
        playback = self._playback
        if playback is None:
            self.node.get_logger().error(f"joint_trajectory: {self._not_ready()}")
            return

        def replace() -> None:
            """Replace the present motion, as a trajectory controller does."""
            trajectory = _requested_trajectory(message, self._simulation.rate)
            begun, lead, seed = time.monotonic(), _LEAD, self._settings.seed
            with self._planning:
                while (sample := playback.change(lead)) is not None:
                    history = self._references[: sample + 1]
                    elapsed = time.monotonic() - begun + lead
                    topics, references = self._simulation.continued(
                        history, elapsed, trajectory, seed
                    )
                    if playback.replace(topics, sample):
                        self._references = references
                        return
                    lead *= 2.0
                playback.play(self._from_rest(trajectory))

        in_thread(replace, "planning").add_done_callback(self._planned)

    def _move(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        playback, settings = self._playback, self._settings

        def play() -> None:
            assert playback is not None
            try:
                if settings.trajectory:
                    trajectory = read_trajectory(Path(settings.trajectory))
                else:
                    trajectory = self._random_motion(settings.motion_duration, settings.motion_seed)
                playback.play(self._from_rest(trajectory))
            finally:
                self._planning.release()

        if playback is None:
            response.message = self._not_ready()
        elif playback.moving or not self._planning.acquire(blocking=False):
            response.message = "busy: the robot is moving; wait until it rests"
        else:
            response.success, response.message = True, "planning, then moving"
            in_thread(play, "planning").add_done_callback(self._planned)
        return response

    def _not_ready(self) -> str:
        return f"not ready for {time.monotonic() - self._begun:.0f} s: {_COMPILING}"

    def _planned(self, done: Future[None]) -> None:
        if (error := done.exception()) is not None:  # the next motion may be one that can be
            defect = f"defect in idim_iv_ros ({one_line(error)})"
            self._problem = str(error) if isinstance(error, IdimError) else defect

    def _random_motion(self, duration: float, seed: int) -> Trajectory:
        configuration, rate = self._simulation.robot.configuration, self._simulation.rate
        return random_motion(configuration, duration=duration, rate=rate, seed=seed)

    def _from_rest(self, trajectory: Trajectory | None) -> list[JointTopic]:
        topics, self._references = self._simulation.published(
            self._references[-1], trajectory, self._settings.seed
        )
        return topics

    def _report(self) -> None:
        self._playback = self._playback or self._begin()
        if self._playback is None:
            return
        moving = self._playback.moving or self._planning.locked()
        if moving != self._said:
            self._said = moving
            self._moving.publish(Bool(data=moving))
        problem, self._problem = self._problem or self._playback.failure, ""
        if problem:
            self.node.get_logger().error(problem)


def _requested_trajectory(message: JointTrajectory, rate: float) -> Trajectory:
    points, joints = message.points, message.joint_names
    counts = {len(point.positions) for point in points} - {len(joints)}
    if counts:
        raise UsageError(f"joint_trajectory: {counts.pop()} positions for {len(joints)} joints")
    times = [p.time_from_start.sec + 1e-9 * p.time_from_start.nanosec for p in points]
    positions = np.array([point.positions for point in points], dtype=float)
    velocities = None
    if all(len(point.velocities) == len(point.positions) for point in points):
        velocities = np.array([point.velocities for point in points], dtype=float)
    return commanded(joints, np.array(times, dtype=float), positions, velocities, rate)


run = partial(run_node, "robot_simulator", RobotSimulator, ABOUT)
