"""Joint quantities as they arrive, many messages at once."""

from collections.abc import Mapping, Sequence

import numpy as np
from rclpy.node import Node

from idim_iv_ros.errors import IdimError
from idim_iv_ros.nodes.recorder.topic_monitor import batch_of
from idim_iv_ros.nodes.recorder.watched_topic import WatchedTopic
from idim_iv_ros.prediction import JointSamples
from idim_iv_ros.recording.bags.cdr import MessageBatch
from idim_iv_ros.recording.bags.definitions import (
    FLOAT_ARRAY,
    JOINT_STATE,
    ROS2_CONTROL,
    SchemaText,
)
from idim_iv_ros.recording.bags.joint_message_type import JointMessageType
from idim_iv_ros.recording.bags.joint_messages import JointMessageReader, JointMessages

_DEPTH = 5_000  # messages that wait: 0.5 s at 10 kHz
_NEWEST = 32  # the same where the newest are enough: joints may have messages of their own
_LARGEST = 1_000_000  # bytes


class JointTopic:
    """One topic whose numbers are put in the order of the joints, read as the recordings are.

    Parameters
    ----------
    node : Node
    name : str
        Resolved in the namespace of the node.
    joints : sequence of str
    fields : mapping of str to (str or None)
        ``position``, ``effort`` or both, and the field of the message that holds each where the
        configuration names one.
    reference : bool
        Whether it is what the controller was asked for, rather than what was measured.
    newest : bool
        Whether the newest messages are enough: those before are dropped, and nothing is sent again.

    Attributes
    ----------
    name : str
        Fully qualified.
    damaged : int
        Messages that are not of their type.
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
        # A field that is named may belong to any type.
        types = None if any(fields.values()) else [JOINT_STATE, *ROS2_CONTROL]
        if types is not None and list(fields) == ["effort"]:
            types.append(FLOAT_ARRAY)
        depth = _NEWEST if newest else _DEPTH
        self._topic = WatchedTopic(
            node, self.name, types, joints, list(fields), depth, best_effort=newest
        )
        self._joints, self._fields, self._reference = list(joints), dict(fields), reference
        self.damaged = 0
        self._lacks, self._met = "", False

    def look(self) -> None:
        """Look for publishers."""
        self._topic.look()

    def close(self) -> None:
        """Unsubscribe."""
        self._topic.close()

    @property
    def problem(self) -> str:
        """Why nothing can come from here; empty where there is no reason."""
        if self._topic.problem:
            return f"{self.name}: {self._topic.problem.removesuffix(': not recorded')}"
        if self._topic.publishers == 0:
            return f"nobody publishes {self.name}"
        return f"{self.name}: {self._lacks}" if self._lacks else ""

    def take(self) -> dict[str, JointSamples]:
        """Return everything that arrived since the last call, quantity by quantity."""
        taken, channel = self._topic.take(_LARGEST), self._topic.channel
        if not taken or channel is None:
            nothing = JointSamples(np.zeros(0, np.int64), np.zeros((0, len(self._joints))))
            return dict.fromkeys(self._fields, nothing)
        arrived = batch_of(self.name, taken)
        # Of drivers that leave the stamp empty, and of arrays of numbers, which have none.
        times = np.where(arrived.sent > 0, arrived.sent, arrived.received)
        batch = MessageBatch.of(list(zip(times.tolist(), arrived.messages, strict=True)))
        self._lacks = ""
        schema = SchemaText("ros2msg", channel.definition.text)
        samples: dict[str, JointSamples] = {}
        for field in dict.fromkeys(self._fields.values()):
            quantities = [name for name, own in self._fields.items() if own == field]
            kind = JointMessageType(channel.message_type, schema, field, self._reference)
            samples.update(self._read(batch, kind, quantities))
        return samples

    def _read(
        self, batch: MessageBatch, kind: JointMessageType, quantities: list[str]
    ) -> dict[str, JointSamples]:
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
        whole = np.any(
            [np.isfinite(value).any(axis=1) for value in messages.values.values()], axis=0
        )
        self._met = self._met or bool(whole.any())
        # Between two messages of these joints there may be any number of another part's.
        if (len(time) and not whole.any()) or (messages.passed and not self._met):
            self._lacks = self._missing(messages)
        named = messages.named[messages.layout][whole]
        return {
            name: JointSamples(time[whole], values[whole], None if named.all() else named)
            for name, values in messages.values.items()
        }

    def _missing(self, messages: JointMessages) -> str:
        absent = [joint for joint in self._joints if joint not in messages.names]
        if messages.names and absent:
            return f"it does not hold joint {', '.join(absent)}"
        return f"it holds no {' and no '.join(messages.values)}"
