"""From raw messages to stamped numbers of the requested joints."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from idim_iv_ros.errors import DataError
from idim_iv_ros.recording.bags.bag_file import MessageBatch
from idim_iv_ros.recording.bags.joint_message_type import (
    JOINT_STATE,
    PLAIN,
    QUANTITIES,
    ROS2_CONTROL,
    JointMessageType,
    JointValues,
)
from idim_iv_ros.recording.recording import ClockQuality, Note
from idim_iv_ros.signal_source import topic_of
from idim_iv_ros.types import BoolArray, FloatArray, IntArray

_TOGETHER = 200_000  # messages
_UNREAD, _PASSED = -1, -2  # instead of the number of a layout
_STAMP = slice(4, 12)  # in the bytes of a JointState


@dataclass(frozen=True)
class JointMessages:
    """All messages of one topic, in the order of the file; `stamp_messages` sorts them by time.

    `stamps`: those of the headers, zero without; of sorted messages increasing times of sampling.
    """

    topic: str
    stamps: IntArray  # (n,), ns
    arrival: IntArray  # (n,), log time, ns
    values: dict[str, FloatArray]  # (n, n_joints) by quantity, NaN where a message lacks the joint
    layout: IntArray  # (n,), number of the layout (joint order, fields) of each message
    named: BoolArray  # (n_layouts, n_joints), joints that a layout names
    damaged: int  # number of unreadable messages
    passed: int  # number of those that name other joints only, say of a gripper
    names: tuple[str, ...]  # of all joints
    origins: dict[str, str] = field(default_factory=dict)  # field by quantity, if it has several
    # Least and largest position of joints not requested, rad (m).
    ranges: dict[str, tuple[float, float]] = field(default_factory=dict)
    clock: ClockQuality | None = None  # set by `stamp_messages`
    said: tuple[Note, ...] = ()  # what was done to the messages

    def __len__(self) -> int:
        return len(self.stamps)

    def notes(self, *, some_joints: bool) -> list[Note]:
        """Return notes for the user: what was done, left out, changing layouts, missing values.

        With `some_joints`, joints without any value do not count as missing.
        """
        notes = list(self.said)
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
            finite = np.isfinite(values)
            finite = finite[:, finite.any(axis=0)] if some_joints else finite
            missing = int(np.count_nonzero(~finite))
            if missing and missing < finite.size:
                notes.append(Note(self.topic, f"{name}: values missing or NaN", missing))
        return notes

    def taken(self, places: IntArray) -> "JointMessages":
        """Return the messages at `places` (k,), in this order."""
        return replace(
            self,
            stamps=self.stamps[places],
            arrival=self.arrival[places],
            values={name: values[places] for name, values in self.values.items()},
            layout=self.layout[places],
        )

    def with_values(self, name: str, values: FloatArray, *notes: Note) -> "JointMessages":
        """Return the messages with other values (n, n_joints) of a field, and notes added."""
        return replace(self, values={**self.values, name: values}, said=(*self.said, *notes))


class _Block(NamedTuple):
    """Messages of one layout: places in a batch and stamps, ns (k,), numbers (k, n) by quantity."""

    places: IntArray | list[int]
    stamps: IntArray | list[int]
    numbers: dict[str, FloatArray]


def _equal_layout(
    batch: MessageBatch, message: bytes, values: JointValues, unread: BoolArray
) -> _Block | None:
    """Decode at once all JointStates of a batch with the same layout as one `message`.

    Drivers nearly always publish the same joints in the same order. Such messages differ in stamp
    and numbers only. None for numbers with another byte order.
    """
    whole, size = np.frombuffer(message, dtype=np.uint8), len(message)
    fixed = np.ones(size, dtype=bool)
    fixed[_STAMP] = False
    offsets = {
        name: numbers.ctypes.data - whole.ctypes.data for name, numbers in values.numbers.items()
    }
    for name, offset in offsets.items():
        if not 0 <= offset < size:
            return None
        fixed[offset : offset + values.numbers[name].nbytes] = False
    places = np.flatnonzero(unread & (batch.sizes == size))
    # Rows of a view are copied whole; an index for each byte takes eight times the memory.
    rows = sliding_window_view(batch.buffer, size)[batch.offsets[places]]
    alike = (rows[:, fixed] == whole[fixed]).all(axis=1)
    places, rows = places[alike], rows[alike]
    stamps = np.ascontiguousarray(rows[:, _STAMP]).view([("sec", "<i4"), ("nanosec", "<u4")])[:, 0]
    return _Block(
        places,
        stamps["sec"].astype(np.int64) * 1_000_000_000 + stamps["nanosec"],
        {
            name: np.ascontiguousarray(rows[:, o : o + values.numbers[name].nbytes]).view("<f8")
            for name, o in offsets.items()
        },
    )


@dataclass(frozen=True)
class _Layout:
    """Joints and fields that messages have in common."""

    number: int  # from 0, in the order of occurrence
    names: tuple[str, ...]  # of the joints in a message
    columns: IntArray  # (k,), of the requested joints in the result
    places: IntArray  # (k,), of these in the message
    origins: dict[str, str]  # see `JointMessages`


@dataclass
class JointMessageReader:
    """Decodes batches of one topic and collects the requested fields."""

    topic: str  # name by the user, perhaps with a field
    kind: JointMessageType
    joints: Sequence[str]
    fields: Sequence[str]  # position, velocity or effort, which is the data of an array of numbers
    grows: bool = False  # whether joints that messages name are appended to `joints`
    damaged: int = 0
    passed: int = 0
    _ranges: dict[str, tuple[float, float]] = field(default_factory=dict)
    _layouts: dict[object, _Layout] = field(default_factory=dict)
    _merged: int = 0
    _waiting: int = 0
    # Stamps, times of arrival and layouts (3, n), and values.
    _parts: list[tuple[IntArray, dict[str, FloatArray]]] = field(default_factory=list)

    def add(self, batch: MessageBatch) -> None:
        """Decode a batch; JointStates of equal layout are decoded together."""
        stamps = np.zeros(len(batch), dtype=np.int64)
        which = np.full(len(batch), _UNREAD)
        blocks: list[tuple[_Layout, _Block]] = []
        for number in range(len(batch)):
            if which[number] != _UNREAD:
                continue
            message, joint_state = batch.message(number), self.kind.name == JOINT_STATE
            try:
                values = self.kind.read(message, QUANTITIES if joint_state else self.fields)
            except DataError:
                self.damaged += 1
                continue
            layout = self._layout(values)
            block = _Block(
                [number], [values.stamp], {n: v[None] for n, v in values.numbers.items()}
            )
            if joint_state:
                block = _equal_layout(batch, message, values, which == _UNREAD) or block
            if self.joints and layout.names and not len(layout.columns):
                which[block.places] = _PASSED
                continue
            which[block.places], stamps[block.places] = layout.number, block.stamps
            blocks.append((layout, block))
        columns: dict[str, FloatArray] = {}
        for layout, block in blocks:
            positions = block.numbers.get("position", np.zeros((0, 0)))
            for joint, motion in zip(layout.names, positions.T, strict=False):
                if joint not in self.joints and np.isfinite(motion).all():
                    low, high = self._ranges.get(joint, (np.inf, -np.inf))
                    ends = float(motion.min()), float(motion.max())
                    self._ranges[joint] = min(low, ends[0]), max(high, ends[1])
            for name in set(self.fields) & set(block.numbers):
                filled = layout.places < block.numbers[name].shape[1]
                if name not in columns:
                    columns[name] = np.full((len(batch), len(self.joints)), np.nan)
                target = np.ix_(block.places, layout.columns[filled])
                columns[name][target] = block.numbers[name][:, layout.places[filled]]
        read = which >= 0
        self.passed += int(np.count_nonzero(which == _PASSED))
        kept = {name: values[read] for name, values in columns.items()}
        self._parts.append((np.array([stamps, batch.arrival, which])[:, read], kept))
        self._waiting += int(read.sum())
        if self._waiting >= _TOGETHER:
            self._merge(self._merged)

    def _layout(self, values: JointValues) -> _Layout:
        """Return the layout of a message, a new one if no earlier message has it.

        Raises DataError: the numbers have no names, and are not as many as the joints.
        """
        sizes = {name: len(numbers) for name, numbers in values.numbers.items()}
        key = (values.names, *sizes.items())
        if key in self._layouts:
            return self._layouts[key]
        if self.kind.name not in (JOINT_STATE, *ROS2_CONTROL) and not values.names:
            count, needed = max(sizes.values(), default=0), len(self.joints)
            if count not in (0, needed):
                raise DataError(f"{self.topic}: {count} numbers in a message for {needed} joints")
            columns = places = list(range(count))
        else:
            if self.grows:
                self.joints = list(dict.fromkeys((*self.joints, *values.names)))
            columns = [k for k, joint in enumerate(self.joints) if joint in values.names]
            places = [values.names.index(self.joints[column]) for column in columns]
        layout = _Layout(
            len(self._layouts),
            values.names,
            np.array(columns, dtype=np.int64),
            np.array(places, dtype=np.int64),
            {} if self.kind.name in PLAIN else values.origins,
        )
        self._layouts[key] = layout
        return layout

    def _merge(self, first: int) -> None:
        """Concatenate the parts from `first` on: many small arrays fragment the memory."""
        parts, merged, width = self._parts[first:], {}, len(self.joints)
        heads = np.hstack([np.zeros((3, 0), dtype=np.int64), *(head for head, _ in parts)])
        for name in self.fields:
            if any(name in values for _, values in parts):
                # NaN where a field is missing, and for joints that came later.
                merged[name] = np.full((heads.shape[1], width), np.nan)
                end = 0
                for head, values in parts:
                    begin, end = end, end + head.shape[1]
                    if name in values:
                        piece = values.pop(name)
                        merged[name][begin:end, : piece.shape[1]] = piece
        self._parts[first:] = [(heads, merged)]
        self._merged, self._waiting = len(self._parts), 0

    def before(self, arrival: int) -> "JointMessageReader":
        """Move the messages that arrived before a time, ns, to a new reader."""
        parts, self._parts = self._parts, []
        earlier = replace(self, _parts=[])
        for heads, values in parts:
            inside = heads[1] < arrival
            for reader, chosen in ((earlier, inside), (self, ~inside)):
                kept = {name: value[chosen] for name, value in values.items()}
                reader._parts.append((heads[:, chosen], kept))
        self.damaged = self.passed = self._merged = self._waiting = 0
        return earlier

    def finish(self) -> JointMessages:
        """Return all messages that were read; the reader is empty afterwards."""
        self._merge(0)
        (stamps, arrival, layout), read = self._parts.pop()
        absent = np.broadcast_to(np.nan, (len(stamps), len(self.joints)))
        values = {name: read.get(name, absent) for name in self.fields}
        self._merged = 0
        names: dict[str, None] = {}
        origins: dict[str, str] = {}
        named = np.zeros((len(self._layouts), len(self.joints)), dtype=bool)
        for met in self._layouts.values():
            names.update(dict.fromkeys(met.names))
            named[met.number, met.columns] = True
            origins.update(met.origins)
        left_out, ranges = (self.damaged, self.passed), dict(self._ranges)
        heads = self.topic, stamps, arrival, values, layout, named
        return JointMessages(*heads, *left_out, tuple(names), origins, ranges)


def checked_messages(
    path: Path, reader: JointMessageReader, *, optional: bool
) -> tuple[JointMessages, list[Note]]:
    """Return the messages without impossible values, and notes on what was left out.

    With `optional`, some of the joints may be missing.

    Raises DataError: a joint or a field is not there.
    """
    messages = reader.finish()
    topic = reader.topic
    if len(messages) == 0 and not messages.passed:
        damaged = f": all {messages.damaged} are damaged" if messages.damaged else ""
        raise DataError(f"{path}: no message on {topic} can be read{damaged}")
    absent = [joint for joint in reader.joints if messages.names and joint not in messages.names]
    if absent and not (optional and len(absent) < len(reader.joints)):
        raise DataError(
            f"{path}: {topic} never holds joint {absent[0]}; it holds "
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
                of, advice = topic_of(topic), ""
                if reader.kind.name in ROS2_CONTROL:
                    advice = f"; was the controller of {of} active while this was recorded?"
                    if name == "effort":
                        states = "/joint_states"
                        advice = f"; if {states} has it, write `effort: {states}`, not {of}"
                raise DataError(
                    f"{path}: {name} of {joint} on {topic} is empty or NaN in every message{advice}"
                )
    return replace(messages, values=values), notes


# Beyond these a number is no position in rad or m, speed in rad/s or m/s; efforts may be counts.
LARGEST = {"position": 1e6, "velocity": 1e6, "effort": 1e9}
_UNITS = {"position": " rad (or m)", "velocity": " rad/s (or m/s)", "effort": ""}
_MOST = 0.01  # share of the samples that may be so wrong before the rest is not believed either


def without_impossible(
    name: str,
    values: FloatArray,
    joints: Sequence[str],
    where: str,
    advice: str,
    *,
    table: bool = False,
) -> tuple[FloatArray, str]:
    """Replace impossible values by NaN; return the values and a sentence on them, or an empty one.

    `name`: ``position``, ``velocity`` or ``effort`` of `joints`, in `values` (n, n_joints).
    `where`, `advice`: beginning and end of the error. In a `table` rows count from 0, and NaN is
    impossible, too.

    Raises DataError: too many values are impossible.
    """
    most, row, first = LARGEST[name], "row" if table else "message", 0 if table else 1
    # The least and the greatest are found without a copy; NaN makes both of them NaN.
    if values.size == 0 or (values.min() >= -most and values.max() <= most):
        return values, ""
    with np.errstate(invalid="ignore"):
        wrong = np.abs(values) > most
    if table:
        wrong |= np.isnan(values)
    rows = np.flatnonzero(wrong.any(axis=1))
    if len(rows) == 0:
        return values, ""
    column = int(np.argmax(wrong[rows[0]]))
    value = float(values[rows[0], column])
    why = "is not a number" if np.isnan(value) else f"is above {most:g}{_UNITS[name]}"
    begin, end = int(rows[0]) + first, int(rows[-1]) + first
    sentence = f"{row} {begin} holds {value:.3g} for {joints[column]}, which {why}"
    if len(rows) > 1:
        sentence = (
            f"{len(rows)} of {len(values)} {row}s, the first {begin} and the last {end} (counted "
            f"from {first}), hold no possible value; {sentence}"
        )
    if len(rows) > _MOST * len(values):
        raise DataError(f"{where}: {name}: {sentence}; {advice}")
    return np.where(wrong, np.nan, values), f"{name}: {sentence}"
