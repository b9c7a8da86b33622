"""Serialised messages: where their numbers lie, so that thousands are read at once.

JointState and Float64MultiArray have no fixed size, but a driver publishes the same joints in
the same order nearly always: the layout of one message then holds for all that agree with it in
every byte that is neither the stamp nor one of the numbers.
"""

import struct
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from idim_iv_ros.errors import DataError

ByteArray = NDArray[np.uint8]

JOINT_STATE = "sensor_msgs/msg/JointState"
FLOAT_ARRAY = "std_msgs/msg/Float64MultiArray"
_LONGEST = 1 << 20


@dataclass(frozen=True)
class MessageBatch:
    """Serialised messages in one buffer.

    Attributes
    ----------
    buffer : (n_bytes,) uint8
    offsets, sizes : (k,) int
        Where each message lies.
    arrival : (k,) int
        Log time, ns.
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
class CdrLayout:
    """Layout of one message.

    Attributes
    ----------
    size : int
        Bytes of the message, encapsulation header included.
    order : str
        ``<`` or ``>``: byte order.
    stamp : int or None
        Offset of the header's stamp (seconds int32, nanoseconds uint32).
    names : tuple of str
        Joint names; empty for an array without names.
    fields : dict
        Offset and count of the float64 numbers of each field.
    fixed : (size,) uint8
        The bytes of the message it was read from.
    structure : (n,) int
        Places of the bytes that must agree.
    """

    size: int
    order: str
    stamp: int | None
    names: tuple[str, ...]
    fields: dict[str, tuple[int, int]]
    fixed: ByteArray
    structure: NDArray[np.int64]

    def agrees(self, messages: ByteArray) -> NDArray[np.bool_]:
        """Which of `messages` (k, size) have this layout."""
        same = messages[:, self.structure] == self.fixed[self.structure]
        return np.asarray(same.all(axis=1))

    def numbers(self, messages: ByteArray, field: str) -> NDArray[np.float64]:
        """Numbers (k, count) of a field of `messages` (k, size)."""
        offset, count = self.fields[field]
        raw = np.ascontiguousarray(messages[:, offset : offset + 8 * count])
        return raw.view(f"{self.order}f8").astype(np.float64)

    def stamps(self, messages: ByteArray) -> NDArray[np.int64]:
        """Header stamps (k,) in ns; zero where the type has none."""
        if self.stamp is None:
            return np.zeros(len(messages), dtype=np.int64)
        raw = np.ascontiguousarray(messages[:, self.stamp : self.stamp + 8])
        seconds = raw[:, :4].copy().view(f"{self.order}i4")[:, 0].astype(np.int64)
        nanoseconds = raw[:, 4:].copy().view(f"{self.order}u4")[:, 0].astype(np.int64)
        return seconds * 1_000_000_000 + nanoseconds


def read_layout(message: bytes, message_type: str) -> CdrLayout:
    """Read the layout of one message.

    Raises
    ------
    DataError
        The bytes are not a message of this type.
    """
    try:
        return _Cursor(message).layout(message_type)
    except (struct.error, IndexError, UnicodeDecodeError, ValueError) as error:
        raise DataError(f"not a {message_type} message") from error


class _Cursor:
    def __init__(self, message: bytes):
        if len(message) < 8 or message[0] != 0 or message[1] not in (0, 1):
            raise ValueError("no CDR encapsulation header")
        self.message = message
        self.order = "<" if message[1] == 1 else ">"
        self.place = 4

    def layout(self, message_type: str) -> CdrLayout:
        stamp: int | None = None
        names: tuple[str, ...] = ()
        fields: dict[str, tuple[int, int]] = {}
        if message_type == JOINT_STATE:
            stamp = self.place
            self.place += 8
            self.string()
            names = tuple(self.string() for _ in range(self.count()))
            for field in ("position", "velocity", "effort"):
                fields[field] = self.floats()
        else:
            for _ in range(self.count()):
                self.string()
                self.integer()
                self.integer()
            self.integer()
            fields["data"] = self.floats()
        free = np.zeros(len(self.message), dtype=bool)
        if stamp is not None:
            free[stamp : stamp + 8] = True
        for offset, count in fields.values():
            free[offset : offset + 8 * count] = True
        free[self.place :] = True  # padding behind the last field
        # Padding between fields is not written by every serialiser.
        structure = np.flatnonzero(~free)
        fixed = np.frombuffer(self.message, dtype=np.uint8)
        return CdrLayout(len(self.message), self.order, stamp, names, fields, fixed, structure)

    def integer(self) -> int:
        self.align(4)
        (value,) = struct.unpack_from(self.order + "I", self.message, self.place)
        self.place += 4
        return int(value)

    def count(self) -> int:
        value = self.integer()
        if value > _LONGEST:
            raise ValueError("a sequence longer than any robot")
        return value

    def string(self) -> str:
        size = self.integer()
        text = self.message[self.place : self.place + size]
        if len(text) != size:
            raise ValueError("the string passes the end of the message")
        self.place += size
        return text.rstrip(b"\0").decode("utf-8")

    def floats(self) -> tuple[int, int]:
        count = self.count()
        if count:
            self.align(8)
        start = self.place
        self.place += 8 * count
        if self.place > len(self.message):
            raise ValueError("the numbers pass the end of the message")
        return start, count

    def align(self, size: int) -> None:
        self.place += -(self.place - 4) % size
