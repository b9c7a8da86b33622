"""A robot that is always where its trajectory says, and what may be wrong with it."""

import time
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicHermiteSpline
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger
from trajectory_msgs.msg import JointTrajectory

from idim_iv_interfaces.msg import BagClosed, RecorderStatus

JOINTS = ["joint_1", "joint_2"]
PERIOD = 0.02  # s
STATUS = 0.2  # s


class KinematicRobot:
    """Joint states, a trajectory topic as joint_trajectory_controller has it, and a recorder.

    Attributes
    ----------
    received : list
        Trajectories: times, positions and velocities at their points.
    obeys, publishes : bool
    blocked : tuple of float, or None
        The first joint does not get out between these places, rad.
    recorder : list of str
        Calls of the recorder.
    state : int or None
        What the recorder says of itself; None: nothing.
    motion : CubicHermiteSpline or None
        What it follows.
    """

    def __init__(self, node, name: str, bag: Path) -> None:
        self.node, self.bag = node, bag
        self._states = node.create_publisher(JointState, "/joint_states", 10)
        self._closed = node.create_publisher(BagClosed, "/recorder/bag_closed", 10)
        self._heard = node.create_subscription(
            JointTrajectory, f"/{name}/joint_trajectory", self.follow, 10
        )
        self._services = [
            node.create_service(Trigger, "/recorder/start", self._start),
            node.create_service(Trigger, "/recorder/stop", self._stop),
            node.create_service(Trigger, "/recorder/abort", self._abort),
        ]
        self._status = node.create_publisher(RecorderStatus, "/recorder/status", 10)
        self._timers = [
            node.create_timer(PERIOD, self._publish),
            node.create_timer(STATUS, self.report),
        ]
        self.received: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
        self.recorder: list[str] = []
        self.position = np.array([0.2, -0.3])
        self.reset()

    def reset(self) -> None:
        """Nothing is wrong with it, and it rests."""
        self.obeys = self.publishes = True
        self.state: int | None = RecorderStatus.IDLE
        self.blocked: tuple[float, float] | None = None
        self.received.clear()
        self.recorder.clear()
        self.motion = None
        self._begun = 0.0

    def close(self) -> None:
        for timer in self._timers:
            self.node.destroy_timer(timer)
        self.node.destroy_subscription(self._heard)
        for service in self._services:
            self.node.destroy_service(service)
        for publisher in (self._states, self._closed, self._status):
            self.node.destroy_publisher(publisher)

    @property
    def moving(self) -> bool:
        return self.motion is not None and time.monotonic() - self._begun < self.motion.x[-1]

    def hold(self) -> None:
        """Stay where it is."""
        self.motion = None

    def follow(self, message: JointTrajectory) -> None:
        """Drop what it does for a trajectory."""
        times = np.array(
            [p.time_from_start.sec + 1e-9 * p.time_from_start.nanosec for p in message.points]
        )
        order = [list(message.joint_names).index(joint) for joint in JOINTS]
        positions = np.array([list(p.positions) for p in message.points])[:, order]
        velocities = np.array([list(p.velocities) for p in message.points])[:, order]
        self.received.append((times, positions, velocities))
        if self.obeys:
            self.motion = CubicHermiteSpline(times, positions, velocities)
            self._begun = time.monotonic()

    def _publish(self) -> None:
        now, stamp = self._now()
        if self.motion is not None:
            elapsed = min(now - self._begun, self.motion.x[-1])
            place = self.motion(elapsed)
            if self.blocked is not None:
                place[0] = np.clip(place[0], *self.blocked)
            self.position = place
        if self.publishes:
            message = JointState(name=JOINTS, position=self.position.tolist())
            message.header.stamp = stamp
            self._states.publish(message)

    def _now(self):
        """One time on two clocks: monotonic, s, and as a stamp."""
        while True:
            before, stamp, after = time.monotonic(), self.node.get_clock().now(), time.monotonic()
            if after - before < 1e-3:
                return after, stamp.to_msg()

    def report(self) -> None:
        """Say what the recorder does."""
        if self.state is not None:
            self._status.publish(RecorderStatus(state=self.state, bag=str(self.bag)))

    def _start(self, _, response):
        self.recorder.append("start")
        self.state = RecorderStatus.RECORDING
        response.success = True
        return response

    def _stop(self, _, response):
        return self._close("stop", response)

    def _abort(self, _, response):
        return self._close("abort", response)

    def _close(self, how: str, response):
        self.recorder.append(how)
        self.state = RecorderStatus.IDLE
        self._closed.publish(BagClosed(bag=str(self.bag), complete=how == "stop"))
        response.success = True
        return response
