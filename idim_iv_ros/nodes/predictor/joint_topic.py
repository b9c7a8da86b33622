"""Joint states as they arrive, many messages at once."""

from collections.abc import Sequence

import numpy as np
from rclpy.node import Node

from idim_iv_ros.errors import DataError
from idim_iv_ros.nodes.recorder.topic_monitor import Taken, batch_of
from idim_iv_ros.nodes.recorder.watched_topic import WatchedTopic
from idim_iv_ros.prediction import JointSamples
from idim_iv_ros.recording.bags.cdr import (
    FLOAT_ARRAY,
    JOINT_STATE,
    CdrLayout,
    MessageBatch,
    read_layout,
)
from idim_iv_ros.types import FloatArray

_DEPTH = 5_000  # messages that wait: 0.5 s at 10 kHz
_LARGEST = 1_000_000  # bytes
_KEPT = 16  # layouts


class JointTopic:
    """One topic whose numbers are put in the order of the joints.

    Parameters
    ----------
    node : Node
    name : str
        Resolved in the namespace of the node.
    joints : sequence of str
    fields : sequence of str
        ``position``, ``effort``; an array of numbers can hold the efforts.

    Attributes
    ----------
    name : str
        Fully qualified.
    damaged : int
        Messages that are not of their type.
    """

    def __init__(self, node: Node, name: str, joints: Sequence[str], fields: Sequence[str]) -> None:
        self.name = node.resolve_topic_name(name)
        types = [JOINT_STATE, FLOAT_ARRAY] if list(fields) == ["effort"] else [JOINT_STATE]
        self._topic = WatchedTopic(node, self.name, types, joints, fields, _DEPTH)
        self._joints, self._fields = list(joints), list(fields)
        self._layouts: list[CdrLayout] = []
        self.damaged = 0
        self._lacks = self._lacks_now = ""
        self._whole = False

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
        """Return everything that arrived since the last call, field by field."""
        taken = self._topic.take(_LARGEST)
        channel = self._topic.channel
        kind = JOINT_STATE if channel is None else channel.message_type
        width = len(self._joints)
        values = {field: np.full((len(taken), width), np.nan) for field in self._fields}
        if not taken:
            nothing = np.zeros(0, np.int64)
            return {field: JointSamples(nothing, each) for field, each in values.items()}
        self._whole, self._lacks_now = False, ""
        time = self._read(taken, kind, values)
        if self._whole or self._lacks_now:
            self._lacks = "" if self._whole else self._lacks_now
        known = time >= 0
        return {field: JointSamples(time[known], each[known]) for field, each in values.items()}

    def _read(
        self, taken: Sequence[Taken], kind: str, values: dict[str, FloatArray]
    ) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
        """Fill `values` and return the stamps, ns; -1 for damaged messages."""
        arrived = batch_of(self.name, taken)
        sizes = np.array([len(message) for message, _ in taken], dtype=np.int64)
        offsets = np.concatenate([[0], np.cumsum(sizes)[:-1]])
        buffer = np.frombuffer(b"".join(message for message, _ in taken), dtype=np.uint8)
        batch = MessageBatch(buffer, offsets, sizes, arrived.received)
        stamps = np.full(len(taken), -1, dtype=np.int64)
        left = np.arange(len(taken))
        for layout in self._layouts:
            left = self._fill(layout, kind, batch, left, stamps, values)
        while len(left):
            try:
                layout = read_layout(batch.message(int(left[0])), kind)
            except DataError:
                self.damaged += 1
                left = left[1:]
                continue
            self._layouts = [*self._layouts[-_KEPT + 1 :], layout]
            left = self._fill(layout, kind, batch, left, stamps, values)
        # Of drivers that leave the stamp empty, and of arrays of numbers, which have none.
        unstamped = stamps == 0
        sent = np.where(arrived.sent > 0, arrived.sent, arrived.received)
        return np.asarray(np.where(unstamped, sent, stamps))

    def _fill(
        self,
        layout: CdrLayout,
        kind: str,
        batch: MessageBatch,
        left: np.ndarray[tuple[int], np.dtype[np.int64]],
        stamps: np.ndarray[tuple[int], np.dtype[np.int64]],
        values: dict[str, FloatArray],
    ) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
        """Read those of the messages `left` that have this layout, and return the others."""
        sized = left[batch.sizes[left] == layout.size]
        if len(sized) == 0:
            return left
        messages = batch.gather(sized, layout.size)
        agrees = layout.agrees(messages)
        messages, sized = messages[agrees], sized[agrees]
        if len(sized) == 0:
            return left
        lacks = self._missing(layout, kind)
        if lacks:
            # Of another part of the robot, say its gripper; the reason where no others come.
            self._lacks_now = lacks
        else:
            stamps[sized] = layout.stamps(messages)
            self._whole = True
            places = [layout.names.index(joint) for joint in self._joints if layout.names]
            for field in self._fields:
                numbers = layout.numbers(messages, "data" if kind == FLOAT_ARRAY else field)
                values[field][sized] = numbers[:, places] if places else numbers
        return np.asarray(left[~np.isin(left, sized)])

    def _missing(self, layout: CdrLayout, kind: str) -> str:
        """What messages of this layout lack; empty where they hold all that is needed."""
        if kind == FLOAT_ARRAY:
            count = layout.fields["data"][1]
            same = count == len(self._joints)
            return "" if same else f"{count} numbers in a message for {len(self._joints)} joints"
        absent = [joint for joint in self._joints if joint not in layout.names]
        if absent:
            return f"it does not hold joint {', '.join(absent)}"
        for field in self._fields:
            count = layout.fields[field][1]
            if count != len(layout.names):
                return f"{count} values of {field} for {len(layout.names)} joints"
        return ""
