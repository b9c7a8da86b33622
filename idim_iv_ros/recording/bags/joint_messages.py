"""From raw messages to stamped numbers of the joints that are asked for."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from idim_iv_ros.errors import DataError
from idim_iv_ros.recording.bags.cdr import FLOAT_ARRAY, CdrLayout, MessageBatch
from idim_iv_ros.recording.bags.joint_message_type import JointMessageType, PlacedLayout
from idim_iv_ros.recording.recording import Note
from idim_iv_ros.types import FloatArray, IntArray

_TOGETHER = 200_000  # messages


@dataclass(frozen=True)
class JointMessages:
    """All messages of one topic, in the order in which they were found.

    Attributes
    ----------
    topic : str
    stamps, arrival : (n,) int
        Header stamp (zero without header) and log time, ns.
    values : dict
        (n, n_joints) of each field, NaN where a message does not hold the joint.
    layouts : int
        How many different layouts (joint orders, missing fields) there were.
    damaged : int
        Messages that could not be read.
    names : tuple of str
        All joint names that were met.
    origins : dict
        Field of the message that each quantity was read from, where its type has several.
    """

    topic: str
    stamps: IntArray
    arrival: IntArray
    values: dict[str, FloatArray]
    layouts: int
    damaged: int
    names: tuple[str, ...]
    origins: dict[str, str] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.stamps)

    def notes(self) -> list[Note]:
        """What a user should know: damaged messages, changing layouts, missing values."""
        notes = []
        if self.damaged:
            what = "damaged messages were left out"
            notes.append(Note(self.topic, what, self.damaged, limits=True))
        if self.layouts > 1:
            what = "different layouts of the message (joint order or missing fields)"
            notes.append(Note(self.topic, what, self.layouts))
        for name, values in self.values.items():
            missing = int(np.count_nonzero(~np.isfinite(values)))
            if missing and missing < values.size:
                notes.append(Note(self.topic, f"{name}: values missing or NaN", missing))
        return notes


@dataclass
class JointMessageReader:
    """Collects batches of one topic; fields that are not asked for are not kept.

    Attributes
    ----------
    topic : str
        Or a topic with a field, as it is named to a user.
    kind : JointMessageType
    joints : sequence of str
    fields : sequence of str
        ``position``, ``velocity`` or ``effort``; for an array of numbers ``effort`` is its data.
    """

    topic: str
    kind: JointMessageType
    joints: Sequence[str]
    fields: Sequence[str]
    damaged: int = 0
    _layouts: list[CdrLayout] = field(default_factory=list)
    _merged: int = 0
    _waiting: int = 0
    _parts: list[tuple[IntArray, IntArray, dict[str, FloatArray]]] = field(default_factory=list)

    def add(self, batch: MessageBatch) -> None:
        """Read a batch: all messages of a known layout at once, new layouts as they come."""
        stamps = np.zeros(len(batch), dtype=np.int64)
        width = len(self.joints)
        missing = np.broadcast_to(np.nan, (len(batch), width))
        values: dict[str, FloatArray] = dict.fromkeys(self.fields, missing)
        read = np.zeros(len(batch), dtype=bool)
        left = np.arange(len(batch))
        for layout in self._layouts:
            left = self._read(layout, batch, left, stamps, values, read)
        while len(left):
            first, left = left[0], left
            try:
                layout = self.kind.layout(batch.message(int(first)), self.fields)
            except DataError:
                self.damaged += 1
                left = left[1:]
                continue
            self._layouts.append(layout)
            left = self._read(layout, batch, left, stamps, values, read)
        self._parts.append(
            (
                stamps[read],
                batch.arrival[read],
                {name: v[read] for name, v in values.items() if v.flags.writeable},
            )
        )

        self._waiting += int(read.sum())
        if self._waiting >= _TOGETHER:
            self._merge()

    def _merge(self) -> None:
        """Merge small parts: freed one by one at the end they would leave the memory in shreds."""
        small = self._parts[self._merged :]
        fields = {name for part in small for name in part[2]}
        width = len(self.joints)
        merged = {
            name: np.concatenate(
                [part[2].get(name, np.full((len(part[0]), width), np.nan)) for part in small]
            )
            for name in fields
        }
        stamps, arrival = (np.concatenate([part[k] for part in small]) for k in (0, 1))
        self._parts[self._merged :] = [(stamps, arrival, merged)]
        self._merged, self._waiting = len(self._parts), 0

    def _read(
        self,
        layout: CdrLayout,
        batch: MessageBatch,
        left: IntArray,
        stamps: IntArray,
        values: dict[str, FloatArray],
        read: NDArray[np.bool_],
    ) -> IntArray:
        sized = left[batch.sizes[left] == layout.size]
        if len(sized) == 0:
            return left
        messages = batch.gather(sized, layout.size)
        agrees = layout.agrees(messages)
        if not agrees.all():
            messages, sized = messages[agrees], sized[agrees]
        stamps[sized] = layout.stamps(messages)
        read[sized] = True
        places = self._places(layout)
        for name in self.fields:
            source = "data" if self.kind.name == FLOAT_ARRAY else name
            if source not in layout.fields or layout.fields[source][1] == 0:
                continue
            numbers = layout.numbers(messages, source)
            if not values[name].flags.writeable:
                values[name] = np.full(values[name].shape, np.nan)
            for column, place in enumerate(places):
                if place is not None and place < numbers.shape[1]:
                    values[name][sized, column] = numbers[:, place]
        return left[~read[left]]

    def _places(self, layout: CdrLayout) -> list[int | None]:
        if self.kind.numbered and not layout.names:
            count = max(count for _, count in layout.fields.values())
            if count not in (0, len(self.joints)):
                raise DataError(
                    f"{self.topic}: {count} numbers in a message for {len(self.joints)} joints"
                )
            return list(range(count)) or [None] * len(self.joints)
        return [
            layout.names.index(joint) if joint in layout.names else None for joint in self.joints
        ]

    def finish(self) -> JointMessages:
        """All messages that were read; the parts are given up."""
        width = len(self.joints)
        stamps = np.concatenate([part[0] for part in self._parts] or [np.zeros(0, np.int64)])
        arrival = np.concatenate([part[1] for part in self._parts] or [np.zeros(0, np.int64)])
        values = {}
        for name in self.fields:
            if not any(name in part[2] for part in self._parts):
                values[name] = np.broadcast_to(np.nan, (len(stamps), width))
                continue
            absent = np.full((0, width), np.nan)
            pieces = [
                part[2].pop(name, np.broadcast_to(np.nan, (len(part[0]), width)))
                for part in self._parts
            ]
            values[name] = np.concatenate([absent, *pieces])
        self._parts.clear()
        names: dict[str, None] = {}
        origins: dict[str, str] = {}
        for layout in self._layouts:
            names.update(dict.fromkeys(layout.names))
            if isinstance(layout, PlacedLayout):
                origins.update(layout.origins)
        return JointMessages(
            topic=self.topic,
            stamps=stamps,
            arrival=arrival,
            values=values,
            layouts=len(self._layouts),
            damaged=self.damaged,
            names=tuple(names),
            origins=origins,
        )
