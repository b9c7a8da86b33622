"""Serialised messages: where their numbers lie, so that thousands are read at once.

JointState and Float64MultiArray have no fixed size, but a driver publishes the same joints in
the same order nearly always: the layout of one message then holds for all that agree with it in
every byte that is neither the stamp nor one of the numbers.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from rosbags.interfaces import Nodetype

from idim_iv_ros.errors import DataError
from idim_iv_ros.recording.bags.definitions import MessageType
from idim_iv_ros.recording.bags.located import locate

ByteArray = NDArray[np.uint8]

JOINT_STATE = "sensor_msgs/msg/JointState"
FLOAT_ARRAY = "std_msgs/msg/Float64MultiArray"


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


_TEXT, _NUMBER = (Nodetype.BASE, ("string", 0)), (Nodetype.BASE, ("uint32", 0))
_NUMBERS = (Nodetype.SEQUENCE, ((Nodetype.BASE, ("float64", 0)), 0))
_TYPES = {
    JOINT_STATE: MessageType(
        JOINT_STATE,
        {
            JOINT_STATE: [
                ("stamp.sec", _NUMBER),
                ("stamp.nanosec", _NUMBER),
                ("frame_id", _TEXT),
                ("name", (Nodetype.SEQUENCE, (_TEXT, 0))),
                *((name, _NUMBERS) for name in ("position", "velocity", "effort")),
            ]
        },
    ),
    FLOAT_ARRAY: MessageType(
        FLOAT_ARRAY,
        {
            FLOAT_ARRAY: [
                ("dim", (Nodetype.SEQUENCE, ((Nodetype.NAME, "dim"), 0))),
                ("data_offset", _NUMBER),
                ("data", _NUMBERS),
            ],
            "dim": [("label", _TEXT), ("size", _NUMBER), ("stride", _NUMBER)],
        },
    ),
}


def read_layout(message: bytes, message_type: str) -> CdrLayout:
    """Read the layout of one JointState or Float64MultiArray.

    Raises
    ------
    DataError
        The bytes are not a message of this type.
    """
    try:
        located = locate(message, _TYPES[message_type])
    except ValueError as error:
        raise DataError(f"not a {message_type} message") from error
    return CdrLayout(
        size=len(message),
        order=located.order,
        stamp=located.stamp,
        names=located.texts.get("name", ()),
        fields={
            name: (numbers.offset, numbers.count)
            for name, numbers in located.numbers.items()
            if numbers.code.endswith("f8")
        },
        fixed=np.frombuffer(message, dtype=np.uint8),
        structure=located.places,
    )
