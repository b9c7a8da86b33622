"""Joint quantities as they arrive, many messages at once, and the robot's newest position."""

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from rclpy.node import Node

from idim_iv_ros.errors import IdimError
from idim_iv_ros.nodes.entry import steady_timer
from idim_iv_ros.nodes.recorder.topic_monitor import batch_of
from idim_iv_ros.nodes.recorder.topics import WatchedTopic, joint_types
from idim_iv_ros.prediction.live import JointSamples
from idim_iv_ros.recording.bags.bag_file import MessageBatch
from idim_iv_ros.recording.bags.joint_message_type import JointMessageType, SchemaText
from idim_iv_ros.recording.bags.joint_messages import JointMessageReader
from idim_iv_ros.signal_source import field_of, topic_of
from idim_iv_ros.types import FloatArray

_DEPTH = 5_000  # messages that wait: 0.5 s at 10 kHz
_NEWEST = 32  # likewise where only the newest are needed: joints may have separate messages
_LARGEST = 1_000_000  # bytes
_LOOK = 0.01  # s; a callback for each message of a fast robot would take half a core
_SEARCH = 0.1  # s between two looks for publishers
_OLDEST = 1.0  # s that a message is under way; with more the clocks differ


class JointTopic:
    """Subscription to joint quantities, in the order of the joints, decoded as in recordings.

    `fields` are ``position``, ``effort`` or both, with the field of the message that holds it where
    the configuration names one; a `reference` is the controller's. Of the `newest` messages older
    ones may be dropped (best effort). `damaged` counts messages that are not of their type.
    """

    def __init__(
        self,
        node: Node,
        name: str,
        joints: Sequence[str],
        fields: Mapping[str, str | None],
        *,
        reference: bool = False,
        newest: bool = False,
    ) -> None:
        self.name = node.resolve_topic_name(name)
        wanted, depth = list(fields), _NEWEST if newest else _DEPTH
        types = joint_types(wanted, named_field=any(fields.values()))
        self._topic = WatchedTopic(
            node, self.name, types, depth, joints, wanted, best_effort=newest
        )
        self._joints, self._fields, self._reference = list(joints), dict(fields), reference
        self.damaged = 0
        self._lacks, self._met = "", False

    def look(self) -> None:
        """Look for publishers, and subscribe to the topic."""
        self._topic.look()

    def close(self) -> None:
        """Unsubscribe."""
        self._topic.close()

    @property
    def problem(self) -> str:
        """Return why no samples can come from the topic; empty if they can."""
        if self._topic.problem:
            return f"{self.name}: {self._topic.problem.removesuffix(': not recorded')}"
        if self._topic.publishers == 0:
            return f"nobody publishes {self.name}"
        return f"{self.name}: {self._lacks}" if self._lacks else ""

    def take(self) -> dict[str, JointSamples]:
        """Return all samples that arrived since the last call, by quantity."""
        taken, channel = self._topic.take(_LARGEST), self._topic.channel
        nothing = JointSamples(np.zeros(0, np.int64), np.zeros((0, len(self._joints))))
        samples = dict.fromkeys(self._fields, nothing)
        if taken and channel is not None:
            arrived = batch_of(taken)
            # Some drivers leave the stamp empty, and arrays of numbers have none.
            times = np.where(arrived.sent > 0, arrived.sent, arrived.received)
            batch = MessageBatch.of(list(zip(times.tolist(), arrived.messages, strict=True)))
            self._lacks = ""
            schema = SchemaText("ros2msg", channel.definition.text)
            for field in dict.fromkeys(self._fields.values()):
                kind = JointMessageType(channel.message_type, schema, field, self._reference)
                samples |= self._read(batch, kind, field)
        return samples

    def _read(
        self, batch: MessageBatch, kind: JointMessageType, field: str | None
    ) -> dict[str, JointSamples]:
        """Decode a batch into samples by quantity; note in `_lacks` why there are none."""
        quantities = [name for name, source in self._fields.items() if source == field]
        reader = JointMessageReader(self.name, kind, self._joints, quantities)
        try:
            kind.require_readable(self.name, self.name)
            reader.add(batch)
        except IdimError as error:
            reason = str(error).removeprefix(f"{self.name}: ")
            self._lacks = reason.replace(f"{self.name} is ", "it is ", 1)
        messages = reader.finish()
        self.damaged += messages.damaged
        time = np.where(messages.stamps != 0, messages.stamps, messages.arrival)
        whole = np.isfinite(np.hstack(list(messages.values.values()))).any(axis=1)
        self._met = self._met or bool(whole.any())
        # Between two messages of these joints there may be any number of another part's.
        if (len(time) and not whole.any()) or (messages.passed and not self._met):
            absent = [joint for joint in self._joints if joint not in messages.names]
            self._lacks = f"it holds no {' and no '.join(messages.values)}"
            if messages.names and absent:
                self._lacks = f"it does not hold joint {', '.join(absent)}"
        named = messages.named[messages.layout][whole]
        return {
            name: JointSamples(time[whole], values[whole], None if named.all() else named)
            for name, values in messages.values.items()
        }


@dataclass(frozen=True)
class Place:
    """Position of a robot at one time."""

    position: FloatArray  # (n_joints,), rad (m), in the order of the configuration
    heard: float  # monotonic time of receipt, s
    measured: float  # of the stamp; of receipt where that is by another clock


class JointPositions:
    """The newest positions of all joints from one topic; other joints are ignored.

    `source` is any topic of joints, or ``topic#field``. `last` is None before all positions have
    come. Its stamp is the oldest of the joints' newest ones, which may come in several messages;
    one that is repeated is ignored: drivers may repeat messages when the robot is off.
    """

    def __init__(
        self, node: Node, source: str, joints: Sequence[str], *, reference: bool = False
    ) -> None:
        self._node = node
        fields, topic = {"position": field_of(source)}, topic_of(source)
        self._topic = JointTopic(node, topic, joints, fields, reference=reference, newest=True)
        self.topic = self._topic.name
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
    def problem(self) -> str:
        """Return why no position can come from the topic; empty if one can."""
        absent = f"{self.topic}: no position of {self._absent}" if self._absent else ""
        return self._topic.problem or absent

    def age(self) -> float:
        """Return the time since the last position, s; infinite before the first."""
        return np.inf if self.last is None else time.monotonic() - self.last.heard

    def close(self) -> None:
        """Unsubscribe."""
        for timer in self._timers:
            self._node.destroy_timer(timer)
        self._topic.close()

    def _look(self) -> None:
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
