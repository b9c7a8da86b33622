"""Where the numbers and texts of a serialised message lie, of any type that is defined."""

import struct
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from rosbags.interfaces import Nodetype

from idim_iv_ros.recording.bags.definitions import MessageType
from idim_iv_ros.types import IntArray

_SIZES = {
    "bool": "u1", "byte": "u1", "char": "u1", "octet": "u1",
    "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4",
    "int64": "i8", "uint64": "u8", "float32": "f4", "float64": "f8",
}  # fmt: skip
_DEEPEST, _MOST_ITEMS = 20, 100_000


@dataclass(frozen=True)
class Numbers:
    """Numbers of one type in a row: offset of the first, how many, NumPy's code of the type."""

    offset: int
    count: int
    code: str


@dataclass
class Located:
    """What a walk through one message gives; items of a sequence are ``name[0]``, ``name[1]``, ….

    Attributes
    ----------
    numbers : dict
        Of each path that leads to a number or to several in a row.
    texts : dict
        Of each path that leads to a text (one item) or to several.
    counts : dict
        Items of each sequence or array of messages.
    structure : list of (int, int)
        Bytes that decide where all others lie: lengths and texts.
    end : int
        Where the message ends; padding may follow.
    order : str
        ``<`` or ``>``: byte order.
    """

    order: str
    numbers: dict[str, Numbers] = field(default_factory=dict)
    texts: dict[str, tuple[str, ...]] = field(default_factory=dict)
    counts: dict[str, int] = field(default_factory=dict)
    structure: list[tuple[int, int]] = field(default_factory=lambda: [(0, 4)])
    end: int = 4

    @property
    def stamp(self) -> int | None:
        """Offset of the seconds of the header's stamp, None where there is none."""
        seconds = self.numbers.get("header.stamp.sec") or self.numbers.get("stamp.sec")
        return None if seconds is None else seconds.offset

    @property
    def places(self) -> IntArray:
        """Places (n,) of the bytes of the structure."""
        return np.concatenate([np.arange(start, stop) for start, stop in self.structure])


def locate(message: bytes, kind: MessageType) -> Located:
    """Walk through a message in CDR.

    Raises
    ------
    ValueError
        The bytes are no message of this type, or its definition is not complete.
    """
    if len(message) < 4 or message[0] != 0 or message[1] not in (0, 1):
        raise ValueError("no CDR encapsulation header")
    walk = _Walk(message, kind)
    try:
        walk.message(kind.name, "", 0)
    except (struct.error, UnicodeDecodeError, KeyError) as error:
        raise ValueError(f"no {kind.name}") from error
    return walk.located


class _Walk:
    def __init__(self, message: bytes, kind: MessageType) -> None:
        self.bytes, self.kind = message, kind
        self.located = Located("<" if message[1] == 1 else ">")
        self.items = 0

    def message(self, name: str, path: str, depth: int) -> None:
        self.items += 1
        if depth > _DEEPEST or self.items > _MOST_ITEMS:
            raise ValueError("nested deeper, or of more parts, than any message of a robot")
        for field_name, described in self.kind.fields[name]:
            self.value(described, f"{path}.{field_name}" if path else field_name, depth)

    def value(self, described: tuple[Any, Any], path: str, depth: int) -> None:
        node, detail = described
        if node == Nodetype.NAME:
            self.message(detail, path, depth + 1)
        elif node == Nodetype.BASE:
            if detail[0] == "string":
                self.located.texts[path] = (self.text(),)
            else:
                self.row(path, 1, detail[0])
        else:
            item, count = detail
            self.several(item, path, self.count() if node == Nodetype.SEQUENCE else count, depth)

    def several(self, item: tuple[Any, Any], path: str, count: int, depth: int) -> None:
        node, detail = item
        if node == Nodetype.BASE and detail[0] != "string":
            self.row(path, count, detail[0])
            return
        self.items += count
        if self.items > _MOST_ITEMS:
            raise ValueError("longer than any message of a robot")
        if node == Nodetype.BASE:
            self.located.texts[path] = tuple(self.text() for _ in range(count))
            return
        self.located.counts[path] = count
        for number in range(count):
            self.value(item, f"{path}[{number}]", depth)

    def row(self, path: str, count: int, base: str) -> None:
        code = _SIZES[base]
        size = int(code[1])
        if count:
            self.align(size)
        self.located.numbers[path] = Numbers(self.located.end, count, self.located.order + code)
        self.advance(size * count)

    def count(self) -> int:
        self.align(4)
        start = self.located.end
        self.advance(4)
        self.located.structure.append((start, start + 4))
        return int(struct.unpack_from(self.located.order + "I", self.bytes, start)[0])

    def text(self) -> str:
        size = self.count()
        start = self.located.end
        self.advance(size)
        self.located.structure.append((start, start + size))
        return self.bytes[start : start + size].rstrip(b"\0").decode("utf-8")

    def align(self, size: int) -> None:
        self.located.end += -(self.located.end - 4) % size

    def advance(self, size: int) -> None:
        self.located.end += size
        if self.located.end > len(self.bytes):
            raise ValueError("the message ends before its content")
