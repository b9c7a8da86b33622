"""What joint messages hold: joint names, numbers that are missing; all messages, at little cost."""

import struct
from collections.abc import Sequence

import numpy as np

from idim_iv_ros.errors import DataError
from idim_iv_ros.recording.bags.cdr import FLOAT_ARRAY, JOINT_STATE, CdrLayout, read_layout

_NAMES_START = 12  # behind the encapsulation header and the stamp: frame, then names
_READ_AT_ONCE = 20  # unknown layouts that are read in one batch
_KEPT = 64


class JointContent:
    """Watches the content of one topic with joint messages.

    Parameters
    ----------
    message_type : str
    joints : sequence of str
        Joints that the messages should hold; empty if any will do.
    needed : sequence of str
        Fields that must hold numbers: ``position``, ``effort``.

    Attributes
    ----------
    malformed : int
        Messages that are not of the topic's type.
    joint_sets : list of tuple of str
        Sets of joint names in the order in which they were met.
    """

    def __init__(self, message_type: str, joints: Sequence[str], needed: Sequence[str]) -> None:
        self.malformed = 0
        self.joint_sets: list[tuple[str, ...]] = []
        self._type = message_type
        self._joints = tuple(joints)
        self._needed = tuple(needed)
        self._known: dict[tuple[int, bytes], CdrLayout] = {}
        self._end = _NAMES_START
        self._missing: tuple[str, ...] = ()

    @property
    def problems(self) -> list[str]:
        """What the latest messages lack, in words."""
        problems = list(self._missing)
        if len(self.joint_sets) > 1:
            sets = " / ".join(", ".join(names) for names in self.joint_sets[-3:])
            problems.append(f"the set of joints changed: {sets}")
        return problems

    def look(self, messages: Sequence[bytes]) -> None:
        """Look at a batch of serialised messages, in the order of their arrival."""
        known, end, unknown = self._known, self._end, 0
        for message in messages:
            if (len(message), message[_NAMES_START:end]) not in known and unknown < _READ_AT_ONCE:
                unknown += 1
                self._read(message)
                end = self._end
        if messages:
            self._numbers(messages[-1])

    def _read(self, message: bytes) -> None:
        try:
            layout = read_layout(message, self._type)
        except DataError:
            self.malformed += 1
            return
        end = _names_end(message, layout.order) if self._type == JOINT_STATE else _NAMES_START
        if end != self._end or len(self._known) >= _KEPT:
            self._known.clear()
            self._end = end
        self._known[len(message), message[_NAMES_START:end]] = layout
        names = tuple(sorted(layout.names))
        if self._type == JOINT_STATE and names not in self.joint_sets:
            self.joint_sets.append(names)

    def _numbers(self, message: bytes) -> None:
        layout = self._known.get((len(message), message[_NAMES_START : self._end]))
        if layout is None:
            return
        absent = [joint for joint in self._joints if joint not in layout.names]
        if layout.names and absent:
            self._missing = (f"it does not hold joint {', '.join(absent)}",)
            return
        rows = np.frombuffer(message, dtype=np.uint8)[None, :]
        missing = []
        for field in self._needed:
            source = "data" if self._type == FLOAT_ARRAY else field
            values = layout.numbers(rows, source)[0]
            names = layout.names or self._joints
            if len(values) != len(names):
                missing.append(f"{len(values)} values of {field} for {len(names)} joints")
                continue
            bad = [
                joint
                for joint, value in zip(names, values, strict=True)
                if not np.isfinite(value) and (not self._joints or joint in self._joints)
            ]
            if bad:
                missing.append(f"{field} of {', '.join(bad)} is NaN")
        self._missing = tuple(missing)


def header_stamps(messages: Sequence[bytes]) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
    """Stamps (n,) of messages that begin with a header, ns."""
    if not messages:
        return np.zeros(0, dtype=np.int64)
    order = "<" if messages[0][1:2] == b"\x01" else ">"
    raw = b"".join([message[4:12].ljust(8, b"\0") for message in messages])
    stamps = np.frombuffer(raw, dtype=[("sec", order + "i4"), ("nanosec", order + "u4")])
    seconds = stamps["sec"].astype(np.int64)
    return np.asarray(seconds * 1_000_000_000 + stamps["nanosec"], dtype=np.int64)


def _names_end(message: bytes, order: str) -> int:
    """Offset behind the last joint name of a JointState that is known to be whole."""
    unsigned = struct.Struct(order + "I")
    place: int = _NAMES_START
    (size,) = unsigned.unpack_from(message, place)
    place += 4 + size
    place += -(place - 4) % 4
    (count,) = unsigned.unpack_from(message, place)
    place += 4
    for _ in range(count):
        place += -(place - 4) % 4
        (size,) = unsigned.unpack_from(message, place)
        place += 4 + size
    return place
