"""MCAP files chunk by chunk, no object for each message.

Of a file whose summary lists every message only the chunks that hold wanted topics are read, far
away (`ByteSource`) or not; a damaged one costs nothing but itself. The records of any other are
walked from its start, up to a torn end or a record whose head is damaged.
"""

import mmap
import struct
import zlib
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

import lz4.frame
import numpy as np
import zstandard
from numpy.typing import NDArray

from idim_iv_ros.errors import DataError
from idim_iv_ros.recording.bags.bag_file import BagFile, ByteSource, LocalFile, copied
from idim_iv_ros.recording.bags.mcap_records import (
    CHANNEL,
    CHUNK,
    DAMAGED,
    DAMAGED_CONTENT,
    DATA_END,
    FOOTER,
    HEAD,
    MAGIC,
    MESSAGE,
    MESSAGE_HEAD,
    SCHEMA,
    McapDescription,
    Record,
    read_summary,
    records,
)
from idim_iv_ros.recording.bags.message_batch import MessageBatch
from idim_iv_ros.types import IntArray

_READ = (CHUNK, MESSAGE, SCHEMA, CHANNEL)
_LARGEST_CHUNK = 1 << 30
_LARGEST_DESCRIPTION = 1 << 24
_LOOSE_TOGETHER, _LOOSE_BYTES = 10_000, 1 << 26  # messages, and what they span
_FORGOTTEN = 1 << 26  # bytes of a file that stay in memory behind the place of reading


@dataclass
class McapFile(BagFile):
    """One MCAP file; `source` is where the bytes are if not on this machine."""

    source: ByteSource | None = None
    _description: McapDescription = field(default_factory=McapDescription)
    _seen: Counter[int] = field(default_factory=Counter)

    def batches(self, wanted: set[str]) -> Iterator[tuple[str, MessageBatch]]:
        """Raw messages of the wanted topics, chunk by chunk; otherwise as `BagFile`."""
        with self._opened() as source:
            summary = read_summary(source)
            self._description = summary or McapDescription()
            self.topics = self._description.topics
            self.definitions = self._description.definitions
            if summary is not None and summary.lists_every_message(source.size):
                for places in summary.stretches(wanted):
                    start = places[0][0]
                    content = source.read(start, places[-1][1])
                    for first, last in places:
                        yield from self._walk(content[first - start : last - start], wanted, 0)
                self.truncated = False
            else:
                yield from self._whole(source, wanted)
        if summary is not None and summary.counts is not None:
            self._compare(summary.counts, wanted)

    def summarised_topics(self) -> dict[str, str]:
        """Type of each topic by the summary; empty where the file has none."""
        with self._opened() as source:
            summary = read_summary(source)
        return {} if summary is None else dict(summary.topics)

    @contextmanager
    def _opened(self) -> Iterator[ByteSource]:
        if self.source is not None:
            yield self.source
            return
        with self.path.open("rb") as file:
            yield LocalFile(file.fileno())

    def _whole(self, source: ByteSource, wanted: set[str]) -> Iterator[tuple[str, MessageBatch]]:
        """Messages of all records from the start; what is far away is copied to a file."""
        if source.size == 0:
            raise DataError(f"{self.path}: the file is empty")
        with (
            copied(source) if self.source is not None else self.path.open("rb") as file,
            mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content,
        ):
            if MAGIC not in (content[: len(MAGIC)], content[-len(MAGIC) :]):
                raise DataError(f"{self.path}: not an MCAP file")
            yield from self._walk(content, wanted, len(MAGIC))

    def _walk(
        self, content: mmap.mmap | bytes, wanted: set[str], place: int
    ) -> Iterator[tuple[str, MessageBatch]]:
        loose: list[Record] = []
        self.truncated = True
        read = 0
        for record in records(content, place):
            opcode, start, end = record
            if start - read > _FORGOTTEN and isinstance(content, mmap.mmap):
                content.madvise(mmap.MADV_DONTNEED, read, _FORGOTTEN)
                read += _FORGOTTEN
            if opcode in (FOOTER, DATA_END):
                self.truncated = False
                break
            largest = _LARGEST_DESCRIPTION if opcode in (SCHEMA, CHANNEL) else _LARGEST_CHUNK
            if opcode == DAMAGED or (opcode in _READ and end - start > largest):
                self._lose()
            elif opcode == CHUNK:
                chunk = self._decompress(content[start:end], torn=end > len(content))
                yield from self._chunk(chunk, wanted)
            elif end > len(content):
                break
            elif opcode in (SCHEMA, CHANNEL):
                self._describe(opcode, content[start:end])
            elif opcode == MESSAGE:
                loose.append(record)
                if len(loose) >= _LOOSE_TOGETHER or end - loose[0].start > _LOOSE_BYTES:
                    yield from self._loose(content, loose, wanted)
                    loose = []
        if loose:
            yield from self._loose(content, loose, wanted)
        self.counted &= not self.truncated

    def _lose(self) -> None:
        self.damaged += 1
        self.counted = False

    def _describe(self, opcode: int, record: bytes) -> None:
        if self._description.counts is not None:
            return  # the summary has all of it, and a checksum
        try:
            self._description.add(opcode, record)
        except DAMAGED_CONTENT:
            self._lose()

    def _decompress(self, record: bytes, *, torn: bool) -> bytes:
        """Content of a chunk, of a torn one its start; nothing (and counted) of a damaged one."""
        try:
            size, checksum, name = struct.unpack_from("<QII", record, 16)
            compression, payload = record[32 : 32 + name], record[40 + name :]
            if size > _LARGEST_CHUNK:
                raise ValueError("the chunk is too large")
            if torn:
                return start_of(payload, compression, size)
            if compression == b"zstd":
                content = zstandard.ZstdDecompressor().decompress(payload, max_output_size=size)
            elif compression == b"lz4":
                content = bytes(lz4.frame.LZ4FrameDecompressor().decompress(payload, size))
            else:
                content = payload
            if checksum not in (0, zlib.crc32(content)):
                raise ValueError("wrong checksum")
        except (struct.error, ValueError, RuntimeError, EOFError, MemoryError, zstandard.ZstdError):
            self._lose()
            return b""
        return content

    def _chunk(self, chunk: bytes, wanted: set[str]) -> Iterator[tuple[str, MessageBatch]]:
        buffer = np.frombuffer(chunk, dtype=np.uint8)
        for channel, places in self._scan(chunk).items():
            yield from self._batch(buffer, channel, places, wanted)

    def _batch(
        self, buffer: NDArray[np.uint8], channel: int, places: IntArray, wanted: set[str]
    ) -> Iterator[tuple[str, MessageBatch]]:
        """Messages of one channel whose records begin at `places` (k,)."""
        topic = self._description.channels.get(channel)
        self._seen[channel] += len(places)
        if topic in wanted and len(places):
            sizes = integers(buffer, places + 1) - MESSAGE_HEAD
            arrival = integers(buffer, places + HEAD + 6)
            yield topic, MessageBatch(buffer, places + HEAD + MESSAGE_HEAD, sizes, arrival)

    def _scan(self, chunk: bytes) -> dict[int, IntArray]:
        """Walk the records of a chunk, and say where the messages of each channel begin."""
        places: dict[int, list[int]] = {}
        place = 0
        while place + HEAD <= len(chunk):
            opcode, size = struct.unpack_from("<BQ", chunk, place)
            start, end = place + HEAD, place + HEAD + size
            if end > len(chunk):
                break
            if opcode in (SCHEMA, CHANNEL):
                self._describe(opcode, chunk[start:end])
            elif opcode == MESSAGE and size >= MESSAGE_HEAD:
                (channel,) = struct.unpack_from("<H", chunk, start)
                places.setdefault(channel, []).append(place)
            place = end
        return {channel: np.array(starts) for channel, starts in places.items()}

    def _loose(
        self, content: mmap.mmap | bytes, places: list[Record], wanted: set[str]
    ) -> Iterator[tuple[str, MessageBatch]]:
        """Messages outside chunks."""
        first = min(record.start for record in places) - HEAD
        last = max(record.end for record in places)
        buffer = np.frombuffer(content[first:last], dtype=np.uint8)
        by_channel: dict[int, list[int]] = {}
        for record in places:
            (channel,) = struct.unpack_from("<H", content, record.start)
            by_channel.setdefault(channel, []).append(record.start - HEAD - first)
        for channel, starts in by_channel.items():
            yield from self._batch(buffer, channel, np.array(starts), wanted)

    def _compare(self, counts: dict[int, int], wanted: set[str]) -> None:
        """Count what is missing against the summary."""
        self.missing.clear()
        self.counted = True
        for channel, topic in self._description.channels.items():
            if topic in wanted:
                self.missing[topic] += max(0, counts.get(channel, 0) - self._seen[channel])
        if self.missing.total() and not self.truncated:
            self.damaged = max(self.damaged, 1)


def start_of(payload: bytes, compression: bytes, size: int) -> bytes:
    """What can be decompressed of a chunk whose end is missing."""
    if compression == b"zstd":
        return zstandard.ZstdDecompressor().decompressobj().decompress(payload)[:size]
    if compression == b"lz4":
        return bytes(lz4.frame.LZ4FrameDecompressor().decompress(payload, size))
    return payload


def integers(buffer: NDArray[np.uint8], offsets: IntArray) -> IntArray:
    """Little-endian 64-bit integers at unaligned places."""
    raw = buffer[offsets[:, None] + np.arange(8)]
    return np.asarray(raw.view("<i8")[:, 0], dtype=np.int64)
