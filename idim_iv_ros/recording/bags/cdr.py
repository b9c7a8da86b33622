"""Serialised messages: where their numbers lie, so that thousands are read at once.

Messages of joints have no fixed size, but a driver publishes the same joints in the same order
nearly always: the layout of one message then holds for all that agree with it in every length and
every text.
"""

import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from rosbags.interfaces import Nodetype

from idim_iv_ros.recording.bags.definitions import MessageType
from idim_iv_ros.types import FloatArray, IntArray

ByteArray = NDArray[np.uint8]

_SIZES = {
    "bool": "u1", "byte": "u1", "char": "u1", "octet": "u1",
    "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4",
    "int64": "i8", "uint64": "u8", "float32": "f4", "float64": "f8",
}  # fmt: skip
_DEEPEST, _MOST_ITEMS = 20, 100_000


@dataclass(frozen=True)
class MessageBatch:
    """Serialised messages in one buffer.

    `buffer` (n_bytes,) uint8. `offsets`, `sizes` (k,) int: where each message lies. `arrival` (k,)
    int: log time, ns.
    """

    buffer: NDArray[np.uint8]
    offsets: NDArray[np.int64]
    sizes: NDArray[np.int64]
    arrival: NDArray[np.int64]

    @classmethod
    def of(cls, messages: Sequence[tuple[int, bytes]]) -> "MessageBatch":
        """Put messages with their log times one behind the other."""
        sizes = np.array([len(data) for _, data in messages], dtype=np.int64)
        return cls(
            buffer=np.frombuffer(b"".join(data for _, data in messages), dtype=np.uint8),
            offsets=np.concatenate([[0], np.cumsum(sizes)[:-1]]),
            sizes=sizes,
            arrival=np.array([stamp for stamp, _ in messages], dtype=np.int64),
        )

    def __len__(self) -> int:
        return len(self.offsets)

    def message(self, number: int) -> bytes:
        """Bytes of one message."""
        start = int(self.offsets[number])
        return self.buffer[start : start + int(self.sizes[number])].tobytes()

    def gather(self, numbers: NDArray[np.int64], size: int) -> NDArray[np.uint8]:
        """Messages `numbers`, all of `size` bytes, as rows (k, size)."""
        if len(numbers) == 0:
            return np.zeros((0, size), np.uint8)
        # Rows of a view are copied whole; an index for each byte takes eight times the memory.
        return np.asarray(sliding_window_view(self.buffer, size)[self.offsets[numbers]])


@dataclass(frozen=True)
class Column:
    """Where one quantity of all joints lies in a message.

    `origin`: field of the message. `offsets` (n,) int: of each number; -1 where there is none.
    `code`: NumPy's code of the type of the numbers.
    """

    origin: str
    offsets: IntArray
    code: str


@dataclass(frozen=True)
class CdrLayout:
    """Layout of one message.

    `size`: bytes of the message, encapsulation header included. `order`: ``<`` or ``>``: byte
    order. `stamp`: offset of the header's stamp (seconds int32, nanoseconds uint32). `names`: joint
    names; empty for an array without names. `columns`: of each quantity that the message holds.
    `fixed` (size,) uint8: the bytes of the message it was read from. `structure` (n,) int: places
    of the bytes that must agree.
    """

    size: int
    order: str
    stamp: int | None
    names: tuple[str, ...]
    columns: Mapping[str, Column]
    fixed: ByteArray
    structure: IntArray

    def agrees(self, messages: ByteArray) -> NDArray[np.bool_]:
        """Which of `messages` (k, size) have this layout."""
        same = messages[:, self.structure] == self.fixed[self.structure]
        return np.asarray(same.all(axis=1))

    def numbers(self, messages: ByteArray, quantity: str) -> FloatArray:
        """Numbers (k, n) of a quantity of `messages` (k, size); NaN where there is none."""
        column = self.columns[quantity]
        offsets, size = column.offsets, int(column.code[-1])
        present = offsets >= 0
        if present.all() and np.all(np.diff(offsets) == size):
            raw = np.ascontiguousarray(messages[:, offsets[0] : offsets[-1] + size])
            return np.asarray(raw.view(column.code), dtype=np.float64)
        values = np.full((len(messages), len(offsets)), np.nan)
        places = offsets[present][:, None] + np.arange(size)
        raw = np.ascontiguousarray(messages[:, places.reshape(-1)])
        values[:, present] = raw.view(column.code).reshape(len(messages), -1)
        return values

    def stamps(self, messages: ByteArray) -> IntArray:
        """Header stamps (k,) in ns; zero where the type has none."""
        if self.stamp is None:
            return np.zeros(len(messages), dtype=np.int64)
        raw = np.ascontiguousarray(messages[:, self.stamp : self.stamp + 8])
        stamp = raw.view([("seconds", f"{self.order}i4"), ("nanoseconds", f"{self.order}u4")])[:, 0]
        seconds = stamp["seconds"].astype(np.int64)
        return np.asarray(seconds * 1_000_000_000 + stamp["nanoseconds"], dtype=np.int64)


@dataclass(frozen=True)
class Numbers:
    """Numbers of one type in a row: offset of the first, how many, NumPy's code of the type."""

    offset: int
    count: int
    code: str


class Located:
    """Where all numbers and texts of one message lie, found by a walk through its CDR.

    Items of a sequence are ``name[0]``, ``name[1]``, ….

    `numbers`: of each path that leads to a number or to several in a row. `texts`: of each path
    that leads to a text (one item) or to several. `counts`: items of each sequence or array of
    messages. `end`: where the message ends; padding may follow.
    Raises ValueError: the bytes are no message of this type, or its definition is not complete.
    """

    def __init__(self, message: bytes, kind: MessageType) -> None:
        if len(message) < 4 or message[0] != 0 or message[1] not in (0, 1):
            raise ValueError("no CDR encapsulation header")
        self.numbers: dict[str, Numbers] = {}
        self.texts: dict[str, tuple[str, ...]] = {}
        self.counts: dict[str, int] = {}
        self.end = 4
        self._message, self._fields = message, kind.fields
        self._order = "<" if message[1] == 1 else ">"
        self._structure = [(0, 4)]
        self._items = 0
        try:
            self._walk_message(kind.name, "", 0)
        except (struct.error, UnicodeDecodeError, KeyError) as error:
            raise ValueError(f"no {kind.name}") from error

    def layout(self, names: tuple[str, ...], columns: Mapping[str, Column | None]) -> CdrLayout:
        """Layout of the message with the columns that are there."""
        stamp = self.numbers.get("header.stamp.sec") or self.numbers.get("stamp.sec")
        return CdrLayout(
            size=len(self._message),
            order=self._order,
            stamp=None if stamp is None else stamp.offset,
            names=names,
            columns={name: column for name, column in columns.items() if column is not None},
            fixed=np.frombuffer(self._message, dtype=np.uint8),
            structure=np.concatenate([np.arange(*places) for places in self._structure]),
        )

    def column(self, origin: str, places: Sequence[tuple[str, int]]) -> Column | None:
        """Column of one number for each joint: ``(path, number in the row)``; None without any."""
        offsets, codes = np.full(len(places), -1), set()
        for joint, (path, number) in enumerate(places):
            row = self.numbers.get(path)
            if row is not None and 0 <= number < row.count:
                offsets[joint] = row.offset + number * int(row.code[-1])
                codes.add(row.code)
        return Column(origin, offsets, codes.pop()) if len(codes) == 1 else None

    def row(self, path: str, width: int | None = None) -> Column | None:
        """Column of the numbers at a path, as many as there are or `width` of them."""
        numbers = self.numbers.get(path)
        count = 0 if numbers is None else numbers.count
        return self.column(path, [(path, k) for k in range(count if width is None else width)])

    def _walk_message(self, name: str, path: str, depth: int) -> None:
        self._count_items(1)
        if depth > _DEEPEST:
            raise ValueError("nested deeper than any message of a robot")
        for field_name, described in self._fields[name]:
            self._walk_value(described, f"{path}.{field_name}" if path else field_name, depth)

    def _walk_value(self, described: tuple[Any, Any], path: str, depth: int) -> None:
        node, detail = described
        if node == Nodetype.NAME:
            self._walk_message(detail, path, depth + 1)
        elif node != Nodetype.BASE:
            item, count = detail
            count = self._read_count() if node == Nodetype.SEQUENCE else count
            self._walk_items(item, path, count, depth)
        elif detail[0] == "string":
            self.texts[path] = (self._read_text(),)
        else:
            self._note_numbers(path, 1, detail[0])

    def _walk_items(self, item: tuple[Any, Any], path: str, count: int, depth: int) -> None:
        node, detail = item
        if node == Nodetype.BASE and detail[0] != "string":
            self._note_numbers(path, count, detail[0])
            return
        self._count_items(count)
        if node == Nodetype.BASE:
            self.texts[path] = tuple(self._read_text() for _ in range(count))
            return
        self.counts[path] = count
        for number in range(count):
            self._walk_value(item, f"{path}[{number}]", depth)

    def _count_items(self, more: int) -> None:
        self._items += more
        if self._items > _MOST_ITEMS:
            raise ValueError("of more parts than any message of a robot")

    def _note_numbers(self, path: str, count: int, base: str) -> None:
        code = _SIZES[base]
        size = int(code[1])
        if count:
            self._align(size)
        self.numbers[path] = Numbers(self.end, count, self._order + code)
        self._advance(size * count)

    def _read_count(self) -> int:
        self._align(4)
        start = self._advance(4)
        self._structure.append((start, start + 4))
        return int(struct.unpack_from(self._order + "I", self._message, start)[0])

    def _read_text(self) -> str:
        size = self._read_count()
        start = self._advance(size)
        self._structure.append((start, start + size))
        return self._message[start : start + size].rstrip(b"\0").decode("utf-8")

    def _align(self, size: int) -> None:
        self.end += -(self.end - 4) % size

    def _advance(self, size: int) -> int:
        """Pass so many bytes, and return where they begin."""
        start, self.end = self.end, self.end + size
        if self.end > len(self._message):
            raise ValueError("the message ends before its content")
        return start
