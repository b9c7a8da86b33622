"""From raw messages to stamped numbers of the joints that are asked for."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from idim_iv_ros.errors import DataError
from idim_iv_ros.recording.bags.cdr import CdrLayout, MessageBatch
from idim_iv_ros.recording.bags.definitions import ROS2_CONTROL
from idim_iv_ros.recording.bags.joint_message_type import PLAIN, JointMessageType
from idim_iv_ros.recording.plausible import without_impossible
from idim_iv_ros.recording.recording import Note
from idim_iv_ros.signal_source import topic_of
from idim_iv_ros.types import BoolArray, FloatArray, IntArray

_TOGETHER = 200_000  # messages
_UNREAD, _PASSED = -1, -2  # instead of a layout


@dataclass(frozen=True)
class JointMessages:
    """All messages of one topic, in the order in which they were found.

    `stamps`, `arrival` (n,) int: header stamp (zero without header) and log time, ns. `values`: (n,
    n_joints) of each field, NaN where a message does not hold the joint. `layout` (n,) int: which
    layout (joint order, missing fields) each has. `named` (n_layouts, n_joints) bool: joints that a
    message of each layout names. `damaged`: messages that could not be read. `passed`: messages
    that name other joints only, say those of a gripper: they were passed over. `names`: all joint
    names that were met. `origins`: field of the message that each quantity was read from, where its
    type has several.
    """

    topic: str
    stamps: IntArray
    arrival: IntArray
    values: dict[str, FloatArray]
    layout: IntArray
    named: BoolArray
    damaged: int
    passed: int
    names: tuple[str, ...]
    origins: dict[str, str] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.stamps)

    def notes(self, *, some_joints: bool = False) -> list[Note]:
        """What a user should know: messages left out, changing layouts, missing values.

        With `some_joints` a joint that is never there misses nothing.
        """
        notes = []
        if self.passed:
            notes.append(Note(self.topic, "messages of other joints were passed over", self.passed))
        if self.damaged:
            what = "damaged messages were left out"
            notes.append(Note(self.topic, what, self.damaged, limits=True))
        layouts = len(np.unique(self.layout))
        if layouts > 1:
            what = "different layouts of the message (joint order or missing fields)"
            notes.append(Note(self.topic, what, layouts))
        for name, values in self.values.items():
            there = np.isfinite(values)
            there = there[:, there.any(axis=0)] if some_joints else there
            missing = int(np.count_nonzero(~there))
            if missing and missing < there.size:
                notes.append(Note(self.topic, f"{name}: values missing or NaN", missing))
        return notes

    def taken(self, places: IntArray) -> "JointMessages":
        """Messages at `places` (k,), in this order."""
        return replace(
            self,
            stamps=self.stamps[places],
            arrival=self.arrival[places],
            values={name: values[places] for name, values in self.values.items()},
            layout=self.layout[places],
        )


@dataclass
class JointMessageReader:
    """Collects batches of one topic; fields that are not asked for are not kept.

    `topic`: or a topic with a field, as it is named to a user. `fields`: ``position``, ``velocity``
    or ``effort``; for an array of numbers ``effort`` is its data.
    """

    topic: str
    kind: JointMessageType
    joints: Sequence[str]
    fields: Sequence[str]
    damaged: int = 0
    passed: int = 0
    _layouts: list[tuple[CdrLayout, list[int | None]]] = field(default_factory=list)
    _merged: int = 0
    _waiting: int = 0
    _parts: list[tuple[tuple[IntArray, ...], dict[str, FloatArray]]] = field(default_factory=list)

    def add(self, batch: MessageBatch) -> None:
        """Read a batch: all messages of a known layout at once, new layouts as they come."""
        stamps = np.zeros(len(batch), dtype=np.int64)
        width = len(self.joints)
        missing = np.broadcast_to(np.nan, (len(batch), width))
        values: dict[str, FloatArray] = dict.fromkeys(self.fields, missing)
        which = np.full(len(batch), _UNREAD)
        left = np.arange(len(batch))
        for number in range(len(self._layouts)):
            left = self._read(number, batch, left, stamps, values, which)
        while len(left):
            try:
                layout = self.kind.layout(batch.message(int(left[0])), self.fields)
            except DataError:
                self.damaged += 1
                left = left[1:]
                continue
            self._layouts.append((layout, self._places(layout)))
            left = self._read(len(self._layouts) - 1, batch, left, stamps, values, which)
        read = which >= 0
        self.passed += int(np.count_nonzero(which == _PASSED))
        self._parts.append(
            (
                (stamps[read], batch.arrival[read], which[read]),
                {name: v[read] for name, v in values.items() if v.flags.writeable},
            )
        )
        self._waiting += int(read.sum())
        if self._waiting >= _TOGETHER:
            self._merge(self._merged)

    def _merge(self, first: int) -> None:
        """Make one of the parts from `first` on: freed one by one they shred the memory."""
        parts, width = self._parts[first:], len(self.joints)
        merged = {}
        for name in self.fields:
            if any(name in values for _, values in parts):
                pieces = [
                    values.pop(name, np.broadcast_to(np.nan, (len(head[0]), width)))
                    for head, values in parts
                ]
                merged[name] = np.concatenate(pieces)
        nothing = np.zeros(0, dtype=np.int64)
        heads = [np.concatenate([nothing, *(head[k] for head, _ in parts)]) for k in range(3)]
        self._parts[first:] = [(tuple(heads), merged)]
        self._merged, self._waiting = len(self._parts), 0

    def _read(
        self,
        number: int,
        batch: MessageBatch,
        left: IntArray,
        stamps: IntArray,
        values: dict[str, FloatArray],
        which: IntArray,
    ) -> IntArray:
        """Read messages `left` (k,) of a layout, and return the others."""
        layout, places = self._layouts[number]
        sized = left[batch.sizes[left] == layout.size]
        if len(sized) == 0:
            return left
        messages = batch.gather(sized, layout.size)
        agrees = layout.agrees(messages)
        if not agrees.all():
            messages, sized = messages[agrees], sized[agrees]
        if self.joints and layout.names and set(places) == {None}:
            which[sized] = _PASSED
            return np.asarray(left[which[left] == _UNREAD])
        stamps[sized] = layout.stamps(messages)
        which[sized] = number
        for name in self.fields:
            if name not in layout.columns:
                continue
            numbers = layout.numbers(messages, name)
            if not values[name].flags.writeable:
                values[name] = np.full(values[name].shape, np.nan)
            for column, place in enumerate(places):
                if place is not None and place < numbers.shape[1]:
                    values[name][sized, column] = numbers[:, place]
        return np.asarray(left[which[left] == _UNREAD])

    def _places(self, layout: CdrLayout) -> list[int | None]:
        if self.kind.numbered and not layout.names:
            count = max((len(c.offsets) for c in layout.columns.values()), default=0)
            if count not in (0, len(self.joints)):
                raise DataError(
                    f"{self.topic}: {count} numbers in a message for {len(self.joints)} joints"
                )
            return list(range(count)) or [None] * len(self.joints)
        return [
            layout.names.index(joint) if joint in layout.names else None for joint in self.joints
        ]

    def before(self, arrival: int) -> "JointMessageReader":
        """Give up the messages that arrived before a time, ns, to a reader of their own."""
        parts, self._parts = self._parts, []
        earlier = replace(self, _parts=[])
        for heads, values in parts:
            inside = heads[1] < arrival
            for reader, chosen in ((earlier, inside), (self, ~inside)):
                kept = {name: value[chosen] for name, value in values.items()}
                reader._parts.append((tuple(head[chosen] for head in heads), kept))
        self.damaged = self.passed = self._merged = self._waiting = 0
        return earlier

    def finish(self) -> JointMessages:
        """All messages that were read; the parts are given up."""
        self._merge(0)
        (stamps, arrival, layout), read = self._parts.pop()
        width = len(self.joints)
        absent = np.broadcast_to(np.nan, (len(stamps), width))
        values = {name: read.get(name, absent) for name in self.fields}
        self._merged = 0
        names: dict[str, None] = {}
        origins: dict[str, str] = {}
        named = np.zeros((len(self._layouts), width), dtype=bool)
        for number, (met, places) in enumerate(self._layouts):
            names.update(dict.fromkeys(met.names))
            named[number] = [place is not None for place in places]
            if self.kind.name not in PLAIN:
                origins.update({name: c.origin for name, c in met.columns.items()})
        return JointMessages(
            topic=self.topic,
            stamps=stamps,
            arrival=arrival,
            values=values,
            layout=layout,
            named=named,
            damaged=self.damaged,
            passed=self.passed,
            names=tuple(names),
            origins=origins,
        )


def checked_messages(
    path: Path, reader: JointMessageReader, *, optional: bool = False
) -> tuple[JointMessages, list[Note]]:
    """Messages without impossible values, and what was left out.

    `optional`: of some joints only, one at least.

    Raises DataError: a joint or a field is not there.
    """
    messages = reader.finish()
    topic = reader.topic
    if len(messages) == 0 and not messages.passed:
        damaged = f": all {messages.damaged} are damaged" if messages.damaged else ""
        raise DataError(f"{path}: no message on {topic} can be read{damaged}")
    absent = [joint for joint in reader.joints if messages.names and joint not in messages.names]
    if optional and len(absent) < len(reader.joints):
        absent = []
    for joint in absent:
        raise DataError(
            f"{path}: {topic} never holds joint {joint}; it holds "
            f"{', '.join(messages.names)}; name the joints to be read in robot.joints"
        )
    notes = []
    values = dict(messages.values)
    for name in reader.fields:
        values[name], sentence = without_impossible(
            name,
            values[name],
            reader.joints,
            f"{path}: {topic}",
            "look at the driver, its units and its byte order",
        )
        if sentence:
            notes.append(Note(topic, f"{sentence}; left out", 1, limits=True))
        if name == "velocity" or optional:
            continue
        for column, joint in enumerate(reader.joints):
            if not np.isfinite(values[name][:, column]).any():
                raise DataError(
                    f"{path}: {name} of {joint} on {topic} is empty or NaN in every message"
                    f"{_where_else(reader, name)}"
                )
    return replace(messages, values=values), notes


def _where_else(reader: JointMessageReader, name: str) -> str:
    """What to write where a controller does not publish a quantity."""
    topic = topic_of(reader.topic)
    if reader.kind.name not in ROS2_CONTROL:
        return ""
    if name == "effort":
        return f"; if /joint_states has it, write `effort: /joint_states`, not {topic}"
    return f"; was the controller of {topic} active while this was recorded?"
