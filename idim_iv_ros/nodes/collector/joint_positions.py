"""Where the robot is, and since when that is known."""

import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.exceptions import InvalidHandle
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState

from idim_iv_ros.nodes.recorder.watched_topic import NeverExecuted
from idim_iv_ros.types import FloatArray

# The newest message is enough, and a publisher of either reliability is heard.
_NEWEST = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
_LOOK = 0.01  # s; a callback for each message of a fast robot would take half a core
_OLDEST = 1.0  # s that a message is under way; with more the clocks differ


@dataclass(frozen=True)
class Place:
    """One message.

    Attributes
    ----------
    position : (n_joints,)
        rad (m), in the order of the configuration.
    heard : float
        Monotonic time of receipt, s.
    measured : float
        Monotonic time of its stamp, s; that of receipt where the stamp is of another clock.
    """

    position: FloatArray
    heard: float
    measured: float


class JointPositions:
    """Positions of all joints from one topic; messages of other joints are passed over.

    A message with the stamp of the one before is no news: some drivers repeat the last one when the
    robot is gone.

    Attributes
    ----------
    last : Place or None
    """

    def __init__(self, node: Node, topic: str, joints: Sequence[str]) -> None:
        self._joints, self._node = tuple(joints), node
        self._stamp: tuple[int, int] | None = None
        self.last: Place | None = None
        self._subscription = node.create_subscription(
            JointState, topic, self._heard, _NEWEST, callback_group=NeverExecuted()
        )
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._timer = node.create_timer(_LOOK, self._look, clock=steady)

    @property
    def topic(self) -> str:
        """Its full name."""
        return str(self._subscription.topic_name)

    def age(self) -> float:
        """Seconds since the last message; infinite before the first."""
        return np.inf if self.last is None else time.monotonic() - self.last.heard

    def close(self) -> None:
        """Hear no more."""
        self._node.destroy_timer(self._timer)
        self._node.destroy_subscription(self._subscription)

    def _look(self) -> None:
        """Take the newest message."""
        with suppress(InvalidHandle), self._subscription.handle:
            taken = self._subscription.handle.take_message(JointState, False)
            if taken is not None:
                self._heard(taken[0])

    def _heard(self, message: Any) -> None:
        stamp = (message.header.stamp.sec, message.header.stamp.nanosec)
        if stamp == self._stamp and stamp != (0, 0):
            return
        places = dict(zip(message.name, message.position, strict=False))
        try:
            position = np.array([places[joint] for joint in self._joints], dtype=float)
        except KeyError:
            return
        if np.isfinite(position).all():
            self._stamp = stamp
            now = time.monotonic()
            ago = self._node.get_clock().now().nanoseconds * 1e-9 - (stamp[0] + 1e-9 * stamp[1])
            self.last = Place(position, now, now - ago if 0.0 <= ago < _OLDEST else now)
