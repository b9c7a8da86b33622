"""Where the robot is, and since when that is known."""

import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from rclpy.node import Node

from idim_iv_ros.nodes.entry import steady_timer
from idim_iv_ros.nodes.joint_topic import JointTopic
from idim_iv_ros.signal_source import field_of, topic_of
from idim_iv_ros.types import FloatArray

_LOOK = 0.01  # s; a callback for each message of a fast robot would take half a core
_SEARCH = 0.1  # s between two looks for publishers
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

    Joints may come in several messages; what counts is the oldest of their newest stamps. A message
    with the stamp of the one before is no news: some drivers repeat the last one when the robot is
    gone.

    Parameters
    ----------
    node : Node
    source : str
        A topic of any type that recordings are read from, or ``topic#field``.
    joints : sequence of str
    reference : bool
        Whether it is what the controller was asked for, rather than what was measured.

    Attributes
    ----------
    last : Place or None
    """

    def __init__(
        self, node: Node, source: str, joints: Sequence[str], *, reference: bool = False
    ) -> None:
        self._node = node
        fields = {"position": field_of(source)}
        self._topic = JointTopic(
            node, topic_of(source), joints, fields, reference=reference, newest=True
        )
        self._joints, self._absent = tuple(joints), ""
        self._position = np.full(len(self._joints), np.nan)
        self._stamps = np.zeros(len(self._joints), dtype=np.int64)
        self._stamp: int | None = None
        self.last: Place | None = None
        self._topic.look()
        self._timers = (
            steady_timer(node, _LOOK, self._look),
            steady_timer(node, _SEARCH, self._topic.look),
        )

    @property
    def topic(self) -> str:
        """Its full name."""
        return self._topic.name

    @property
    def problem(self) -> str:
        """Why nothing can come from here; empty where there is no reason."""
        absent = f"{self.topic}: no position of {self._absent}" if self._absent else ""
        return self._topic.problem or absent

    def age(self) -> float:
        """Seconds since the last message; infinite before the first."""
        return np.inf if self.last is None else time.monotonic() - self.last.heard

    def close(self) -> None:
        """Hear no more."""
        for timer in self._timers:
            self._node.destroy_timer(timer)
        self._topic.close()

    def _look(self) -> None:
        """Take the newest number of each joint."""
        taken = self._topic.take()["position"]
        if not len(taken):
            return
        about = taken.about
        new = np.flatnonzero(about.any(axis=0))
        rows = len(taken) - 1 - np.argmax(about[::-1, new], axis=0)
        self._position[new], self._stamps[new] = taken.values[rows, new], taken.time[rows]
        behind = (self._stamps.max() - self._stamps) * 1e-9 > _OLDEST
        missing = behind | ~np.isfinite(self._position)
        self._absent = ", ".join(np.array(self._joints)[missing])
        stamp = int(self._stamps.min())
        if stamp != self._stamp and not missing.any():
            self._stamp = stamp
            now = time.monotonic()
            ago = 1e-9 * (self._node.get_clock().now().nanoseconds - stamp)
            measured = now - ago if 0.0 <= ago < _OLDEST else now
            self.last = Place(self._position.copy(), now, measured)
