"""MCAP files chunk by chunk: raw messages found by their index, no object for each message.

Records are walked from the start of the file, so that a file without summary or with a torn end
is read as far as it goes. Format: https://mcap.dev/spec.
"""

import mmap
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import lz4.frame
import numpy as np
import zstandard
from numpy.typing import NDArray

from idim_iv_ros.errors import DataError
from idim_iv_ros.recording.message_batch import MessageBatch

MAGIC = b"\x89MCAP0\r\n"
_SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _INDEX = 3, 4, 5, 6, 7
_END = (2, 15)  # footer, data end
_HEAD = 9  # opcode and length
_MESSAGE_HEAD = 22  # channel, sequence, log time, publish time
_LARGEST_CHUNK = 1 << 32


@dataclass
class McapFile:
    """One MCAP file.

    Attributes
    ----------
    path : Path
    topics : dict
        Type of each topic that was met so far.
    truncated : bool
        Whether the file ended before its end record; known once it was read.
    damaged : int
        Chunks that could not be decompressed or whose checksum is wrong; they are left out.
    """

    path: Path
    topics: dict[str, str] = field(default_factory=dict)
    truncated: bool = False
    damaged: int = 0
    _schemas: dict[int, str] = field(default_factory=dict)
    _channels: dict[int, str] = field(default_factory=dict)

    def batches(self, wanted: set[str]) -> Iterator[tuple[str, MessageBatch]]:
        """Raw messages of the wanted topics, chunk by chunk.

        Raises
        ------
        DataError
            Not an MCAP file.
        """
        if self.path.stat().st_size == 0:
            raise DataError(f"{self.path}: the file is empty")
        with (
            self.path.open("rb") as file,
            mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content,
        ):
            if content[: len(MAGIC)] != MAGIC:
                raise DataError(f"{self.path}: not an MCAP file")
            yield from self._walk(content, wanted)

    def _walk(self, content: mmap.mmap, wanted: set[str]) -> Iterator[tuple[str, MessageBatch]]:
        place, chunk = len(MAGIC), None
        indices: dict[int, NDArray[np.int64]] = {}
        loose: list[tuple[int, int]] = []
        self.truncated = True
        while place + _HEAD <= len(content):
            opcode, size = struct.unpack_from("<BQ", content, place)
            start, place = place + _HEAD, place + _HEAD + size
            if chunk is not None and opcode != _INDEX:
                yield from self._chunk(chunk, indices, wanted)
                chunk, indices = None, {}
            if opcode in _END:
                self.truncated = False
                break
            if place > len(content):
                break
            if opcode in (_SCHEMA, _CHANNEL):
                self._describe(opcode, content[start:place])
            elif opcode == _CHUNK:
                chunk = self._decompress(content[start:place])
            elif opcode == _INDEX:
                self._index(content[start:place], indices)
            elif opcode == _MESSAGE:
                loose.append((start - _HEAD, size))
                if len(loose) >= 10_000:
                    yield from self._loose(content, loose, wanted)
                    loose = []
        if chunk is not None:
            yield from self._chunk(chunk, indices, wanted)
        if loose:
            yield from self._loose(content, loose, wanted)

    def _describe(self, opcode: int, record: bytes) -> None:
        try:
            if opcode == _SCHEMA:
                (number,) = struct.unpack_from("<H", record)
                self._schemas[number], _ = _text(record, 2)
                return
            number, schema = struct.unpack_from("<HH", record)
            topic, place = _text(record, 4)
            encoding, _ = _text(record, place)
        except (struct.error, UnicodeDecodeError) as error:
            raise DataError(f"{self.path}: a schema or channel record is damaged") from error
        if encoding == "cdr":
            self._channels[number] = topic
            self.topics[topic] = self._schemas.get(schema, "")

    def _decompress(self, record: bytes) -> bytes | None:
        """Content of a chunk, None (and counted) where it is damaged."""
        try:
            size, checksum = struct.unpack_from("<QI", record, 16)
            compression, place = _text(record, 28)
            payload = record[place + 8 :]
            if size > _LARGEST_CHUNK:
                raise ValueError("the chunk is too large")
            if compression == "zstd":
                content = zstandard.ZstdDecompressor().decompress(payload, max_output_size=size)
            elif compression == "lz4":
                content = bytes(lz4.frame.decompress(payload))
            else:
                content = payload
            if checksum not in (0, zlib.crc32(content)):
                raise ValueError("wrong checksum")
        except (
            struct.error,
            ValueError,
            RuntimeError,
            MemoryError,
            zstandard.ZstdError,
        ):
            self.damaged += 1
            return None
        return content

    def _index(self, record: bytes, indices: dict[int, NDArray[np.int64]]) -> None:
        if len(record) < 6 or (len(record) - 6) % 16:
            return
        (channel,) = struct.unpack_from("<H", record)
        entries = np.frombuffer(record, dtype="<i8", offset=6).reshape(-1, 2)
        indices[channel] = entries[:, 1]

    def _chunk(
        self, chunk: bytes, indices: dict[int, NDArray[np.int64]], wanted: set[str]
    ) -> Iterator[tuple[str, MessageBatch]]:
        if not indices or any(not self._fits(chunk, offsets) for offsets in indices.values()):
            indices = self._scan(chunk)
        else:
            for channel in set(indices) - set(self._channels):
                # The channel is described inside the chunk, where the first message follows it.
                self._scan(chunk[: int(indices[channel][0])])
        buffer = np.frombuffer(chunk, dtype=np.uint8)
        for channel, offsets in indices.items():
            topic = self._channels.get(channel)
            if topic in wanted and len(offsets):
                yield topic, _batch(buffer, offsets)

    def _fits(self, chunk: bytes, offsets: NDArray[np.int64]) -> bool:
        """Whether every entry of an index points at a whole message record."""
        if len(offsets) == 0:
            return True
        last = len(chunk) - _HEAD - _MESSAGE_HEAD
        if offsets.min() < 0 or offsets.max() > last:
            return False
        buffer = np.frombuffer(chunk, dtype=np.uint8)
        if np.any(buffer[offsets] != _MESSAGE):
            return False
        sizes = _integers(buffer, offsets + 1)
        return bool(np.all((sizes >= _MESSAGE_HEAD) & (offsets + _HEAD + sizes <= len(chunk))))

    def _scan(self, chunk: bytes) -> dict[int, NDArray[np.int64]]:
        """Walk the records of a chunk that has no index."""
        found: dict[int, list[int]] = {}
        place = 0
        while place + _HEAD <= len(chunk):
            opcode, size = struct.unpack_from("<BQ", chunk, place)
            start, end = place + _HEAD, place + _HEAD + size
            if end > len(chunk):
                break
            if opcode in (_SCHEMA, _CHANNEL):
                self._describe(opcode, chunk[start:end])
            elif opcode == _MESSAGE and size >= _MESSAGE_HEAD:
                (channel,) = struct.unpack_from("<H", chunk, start)
                found.setdefault(channel, []).append(place)
            place = end
        return {channel: np.array(places) for channel, places in found.items()}

    def _loose(
        self, content: mmap.mmap, places: list[tuple[int, int]], wanted: set[str]
    ) -> Iterator[tuple[str, MessageBatch]]:
        """Messages outside chunks."""
        first, (last, size) = places[0][0], places[-1]
        buffer = np.frombuffer(content[first : last + _HEAD + size], dtype=np.uint8)
        by_channel: dict[int, list[int]] = {}
        for place, length in places:
            if length >= _MESSAGE_HEAD:
                (channel,) = struct.unpack_from("<H", content, place + _HEAD)
                by_channel.setdefault(channel, []).append(place - first)
        for channel, offsets in by_channel.items():
            topic = self._channels.get(channel)
            if topic in wanted:
                yield topic, _batch(buffer, np.array(offsets))


def _batch(buffer: NDArray[np.uint8], offsets: NDArray[np.int64]) -> MessageBatch:
    return MessageBatch(
        buffer=buffer,
        offsets=offsets + _HEAD + _MESSAGE_HEAD,
        sizes=_integers(buffer, offsets + 1) - _MESSAGE_HEAD,
        arrival=_integers(buffer, offsets + _HEAD + 6),
    )


def _integers(buffer: NDArray[np.uint8], offsets: NDArray[np.int64]) -> NDArray[np.int64]:
    """Little-endian 64-bit integers at unaligned places."""
    raw = buffer[offsets[:, None] + np.arange(8)]
    return np.asarray(raw.view("<i8")[:, 0], dtype=np.int64)


def _text(record: bytes, place: int) -> tuple[str, int]:
    (size,) = struct.unpack_from("<I", record, place)
    if place + 4 + size > len(record):
        raise struct.error("the text passes the end of its record")
    return record[place + 4 : place + 4 + size].decode("utf-8"), place + 4 + size
