"""MCAP files read chunk by chunk, without an object for each message.

Where the summary lists every message, only the chunks with wanted topics are read, local or remote
(`ByteSource`), and a damaged chunk loses its content only. Any other file is read record by record
up to a torn end or a damaged record head. The format: https://mcap.dev/spec.
"""

import mmap
import struct
import zlib
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from io import BytesIO
from typing import NamedTuple

import lz4.frame
import numpy as np
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import EndOfFile
from mcap.records import Channel, ChunkIndex, Schema, Statistics
from numpy.typing import NDArray

from idim_iv_ros.errors import DataError
from idim_iv_ros.recording.bags.bag_file import (
    READ_AHEAD,
    BagFile,
    ByteSource,
    MessageBatch,
    opened,
)
from idim_iv_ros.recording.bags.joint_message_type import SchemaText, note_type
from idim_iv_ros.types import IntArray

DAMAGED = 0  # no opcode of the format: bytes that are no record
FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, INDEX, STATISTICS, DATA_END = 2, 3, 4, 5, 6, 7, 11, 15
CHUNK_INDEX = 8
HEAD = 9  # opcode and length
_HEAD_AND_CHANNEL = struct.Struct("<BQH")  # of a message
MESSAGE_HEAD = 22  # channel, sequence, log time, publish time
_LAST_OPCODE, _FIRST_PRIVATE = 15, 0x80

MAGIC = b"\x89MCAP0\r\n"
FOOTER_SIZE = 20
DAMAGED_CONTENT = (struct.error, UnicodeDecodeError, EndOfFile)
"""What the content of a damaged record raises."""

_LONGEST_SUMMARY = 1 << 28
# The end of a file that is read first: the summary of a minute of three topics is in it.
_TAIL = 1 << 14
_READ = (CHUNK, INDEX, MESSAGE, SCHEMA, CHANNEL)
_LARGEST_CHUNK = 1 << 30
_LARGEST_DESCRIPTION = 1 << 24
_LOOSE_BYTES = 1 << 22  # messages outside chunks that are read at once
_FORGOTTEN = 1 << 26  # bytes of a file that stay in memory behind the place of reading


class Record(NamedTuple):
    """One record: its opcode, and where its content lies; `end` may lie behind the file's end."""

    opcode: int
    start: int
    end: int


def records(content: mmap.mmap | bytes, place: int) -> Iterator[Record]:
    """Yield records from `place` on; one with an impossible head is the last, as ``DAMAGED``.

    The last record of a truncated file ends behind the file.
    """
    while place + HEAD <= len(content):
        opcode, size = struct.unpack_from("<BQ", content, place)
        record = Record(opcode, place + HEAD, place + HEAD + size)
        if opcode == CHUNK:
            whole = _is_chunk(content, record)
        elif opcode == MESSAGE:
            whole = size >= MESSAGE_HEAD
        elif opcode in (DATA_END, FOOTER):
            whole = size == (4 if opcode == DATA_END else FOOTER_SIZE)
        else:
            whole = 0 < opcode <= _LAST_OPCODE or opcode >= _FIRST_PRIVATE
        if not whole:
            yield record._replace(opcode=DAMAGED)
            return
        yield record
        place = record.end


def _is_chunk(content: mmap.mmap | bytes, record: Record) -> bool:
    """Return whether the length of a chunk agrees with the lengths of its parts."""
    with suppress(struct.error):  # the file ends before
        (name,) = struct.unpack_from("<I", content, record.start + 28)
        (size,) = struct.unpack_from("<Q", content, record.start + 32 + name)
        return bool(name <= 16 and record.end - record.start == 40 + name + size)
    return False


@dataclass
class McapFile(BagFile):
    """One MCAP file; `source` gives its bytes, from this machine or another."""

    source: ByteSource = field(kw_only=True)
    # From its summary, or else its data.
    _schemas: dict[int, str] = field(default_factory=dict)  # names
    _channels: dict[int, str] = field(default_factory=dict)  # topics, of those of CDR messages
    _counts: dict[int, int] | None = None  # of their messages; None without a summary
    _chunks: list[ChunkIndex] = field(default_factory=list)
    _seen: Counter[int] = field(default_factory=Counter)

    def batches(self, wanted: set[str]) -> Iterator[tuple[str, MessageBatch]]:
        """Yield topic and raw messages of the wanted topics, chunk by chunk; see `BagFile`."""
        summary = self._read_summary()
        if summary and (self._lists_every_message() or (self.topics and not wanted)):
            for places in self._stretches(wanted):
                start = places[0][0]
                data = self.source.read(start, places[-1][1])
                for first, last in places:
                    yield from self._walk(data[first - start : last - start], wanted, 0)
            self.truncated = False
        elif self.source.size == 0:
            raise DataError(f"{self.path}: the file is empty")
        else:  # all records from the start; a remote file is copied first
            with (
                opened(self.source) as file,
                mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content,
            ):
                if MAGIC not in (content[: len(MAGIC)], content[-len(MAGIC) :]):
                    raise DataError(f"{self.path}: not an MCAP file")
                yield from self._walk(content, wanted, len(MAGIC))
        if self._counts is None:
            return
        self.missing.clear()
        self.counted = True
        for channel, topic in self._channels.items():
            if topic in wanted:
                self.missing[topic] += max(0, self._counts.get(channel, 0) - self._seen[channel])
        if self.missing.total() and not self.truncated:
            self.damaged = max(self.damaged, 1)

    def _read_summary(self) -> bool:
        """Return whether there is a description at the end of the file, which is taken over then.

        It is none where its checksum is wrong or one of its records is damaged.
        """
        offset = max(0, self.source.size - _TAIL)
        tail = self.source.read(offset, self.source.size)
        footer = len(tail) - len(MAGIC) - FOOTER_SIZE
        if footer < HEAD or tail[-len(MAGIC) :] != MAGIC or tail[footer - HEAD] != FOOTER:
            return False
        start, _, checksum = struct.unpack_from("<QQI", tail, footer)
        length = offset + footer - HEAD - start
        if start < len(MAGIC) or not 0 < length <= _LONGEST_SUMMARY:
            return False
        if start < offset:
            tail, offset = self.source.read(start, offset) + tail, start
        # A writer that computes no checksum leaves it zero.
        if checksum not in (0, zlib.crc32(tail[start - offset : -len(MAGIC) - 4])):
            return False
        try:
            for record in records(tail, start - offset):
                if record.opcode == FOOTER:
                    break
                self._add(record.opcode, tail[record.start : record.end])
        except DAMAGED_CONTENT:
            self.topics, self.definitions, self._counts = {}, {}, None
            self._schemas, self._channels, self._chunks = {}, {}, []
            return False
        return True

    def _add(self, opcode: int, content: bytes) -> None:
        """Add the content of a record: a schema, a channel, statistics or a chunk index.

        Raises one of `DAMAGED_CONTENT` if it is damaged.
        """
        stream = ReadDataStream(BytesIO(content))
        if opcode == SCHEMA:
            schema = Schema.read(stream)
            self._schemas[schema.id] = schema.name
            # Other encodings than those of ROS need not be text.
            text = schema.data.decode("utf-8", errors="replace")
            self.definitions[schema.name] = SchemaText(schema.encoding, text)
        elif opcode == CHANNEL:
            channel = Channel.read(stream)
            if channel.message_encoding == "cdr":
                self._channels[channel.id] = channel.topic
                note_type(self.topics, channel.topic, self._schemas.get(channel.schema_id, ""))
        elif opcode == STATISTICS:
            self._counts = dict(Statistics.read(stream).channel_message_counts)
        elif opcode == CHUNK_INDEX:
            self._chunks.append(ChunkIndex.read(stream))

    def _lists_every_message(self) -> bool:
        """Return whether the listed chunks hold all messages of the file.

        Messages outside chunks are in no index, and some writers leave the index out.
        """
        last = self.source.size - len(MAGIC) - FOOTER_SIZE - HEAD
        return (
            self._counts is not None
            and (bool(self._chunks) or not any(self._counts.values()))
            and all(
                chunk.message_index_offsets
                and chunk.chunk_length + chunk.message_index_length
                <= last - chunk.chunk_start_offset
                for chunk in self._chunks
            )
        )

    def _stretches(self, wanted: set[str]) -> Iterator[list[tuple[int, int]]]:
        """Yield the places (first, last byte) of chunks with wanted topics, grouped by reads.

        The chunks of a group are adjacent, and have up to `READ_AHEAD` bytes if they are several.
        """
        channels = {channel for channel, topic in self._channels.items() if topic in wanted}
        together: list[tuple[int, int]] = []
        for chunk in sorted(self._chunks, key=lambda chunk: chunk.chunk_start_offset):
            if channels.isdisjoint(chunk.message_index_offsets):
                continue
            first = chunk.chunk_start_offset
            last = first + chunk.chunk_length + chunk.message_index_length
            if together and (first != together[-1][1] or last - together[0][0] > READ_AHEAD):
                yield together
                together = []
            together.append((first, last))
        if together:
            yield together

    def _walk(
        self, content: mmap.mmap | bytes, wanted: set[str], place: int
    ) -> Iterator[tuple[str, MessageBatch]]:
        """Yield the messages of all records from `place` on, and count damages."""
        loose: tuple[int, int] | None = None  # messages outside chunks: where they begin and end
        chunk = b""
        index: dict[int, IntArray] = {}  # of the messages of each channel, behind their chunk
        self.truncated = True
        read = 0
        for record in records(content, place):
            opcode, start, end = record
            if start - read > _FORGOTTEN and isinstance(content, mmap.mmap):
                content.madvise(mmap.MADV_DONTNEED, read, _FORGOTTEN)
                read += _FORGOTTEN
            if opcode != INDEX:
                yield from self._chunk(chunk, wanted, index)
                chunk, index = b"", {}
            if opcode in (FOOTER, DATA_END):
                self.truncated = False
                break
            largest = _LARGEST_DESCRIPTION if opcode in (SCHEMA, CHANNEL) else _LARGEST_CHUNK
            if opcode == DAMAGED or (opcode in _READ and end - start > largest):
                self._count_damage()
            elif opcode == CHUNK:
                if loose is not None:
                    yield from self._chunk(content[slice(*loose)], wanted)
                    loose = None
                chunk = self._decompress(content[start:end], torn=end > len(content))
            elif end > len(content):
                break
            elif opcode in (SCHEMA, CHANNEL):
                self._describe(opcode, content[start:end])
            elif opcode == INDEX and (end - start) % 16 == 6:
                (channel,) = struct.unpack_from("<H", content, start)
                entries = np.frombuffer(content[start + 6 : end], dtype="<i8").reshape(-1, 2)
                index[channel] = entries[:, 1]
            elif opcode == MESSAGE:
                loose = (start - HEAD if loose is None else loose[0], end)
                if end - loose[0] > _LOOSE_BYTES:
                    yield from self._chunk(content[slice(*loose)], wanted)
                    loose = None
        yield from self._chunk(chunk, wanted, index)
        if loose is not None:
            yield from self._chunk(content[slice(*loose)], wanted)
        self.counted &= not self.truncated

    def _count_damage(self) -> None:
        self.damaged += 1
        self.counted = False

    def _describe(self, opcode: int, record: bytes) -> None:
        if self._counts is not None:
            return  # the summary has all of it, and a checksum
        try:
            self._add(opcode, record)
        except DAMAGED_CONTENT:
            self._count_damage()

    def _decompress(self, record: bytes, *, torn: bool) -> bytes:
        """Return the content of a chunk; its beginning if torn, nothing if damaged (counted)."""
        try:
            size, checksum, name = struct.unpack_from("<QII", record, 16)
            compression, payload = record[32 : 32 + name], record[40 + name :]
            if size > _LARGEST_CHUNK:
                raise ValueError("the chunk is too large")
            content = payload
            if compression == b"zstd" and torn:
                content = zstandard.ZstdDecompressor().decompressobj().decompress(payload)[:size]
            elif compression == b"zstd":
                content = zstandard.ZstdDecompressor().decompress(payload, max_output_size=size)
            elif compression == b"lz4":
                content = bytes(lz4.frame.LZ4FrameDecompressor().decompress(payload, size))
            if torn:
                return content
            if checksum not in (0, zlib.crc32(content)):
                raise ValueError("wrong checksum")
        except (struct.error, ValueError, RuntimeError, EOFError, MemoryError, zstandard.ZstdError):
            self._count_damage()
            return b""
        return content

    def _chunk(
        self, chunk: bytes, wanted: set[str], index: Mapping[int, IntArray] | None = None
    ) -> Iterator[tuple[str, MessageBatch]]:
        """Yield the messages of a chunk, by its index if that accounts for every byte."""
        buffer = np.frombuffer(chunk, dtype=np.uint8)
        places = index or {}
        listed = sum(bytes_at(buffer, channel, at) for channel, at in places.items())
        if listed != len(chunk):
            places = self._scan(chunk)
        for channel, at in places.items() if chunk else ():
            topic = self._channels.get(channel)
            self._seen[channel] += len(at)
            if topic in wanted and len(at):
                sizes = integers(buffer, at + 1) - MESSAGE_HEAD
                arrival = integers(buffer, at + HEAD + 6)
                yield topic, MessageBatch(buffer, at + HEAD + MESSAGE_HEAD, sizes, arrival)

    def _scan(self, chunk: bytes) -> dict[int, IntArray]:
        """Return the places (k,) of messages by channel, found by walking a chunk's records."""
        places: defaultdict[int, list[int]] = defaultdict(list)
        place, last, head = 0, len(chunk) - _HEAD_AND_CHANNEL.size, _HEAD_AND_CHANNEL.unpack_from
        while place <= last:
            opcode, size, channel = head(chunk, place)
            end = place + HEAD + size
            if end > len(chunk):
                break
            if opcode == MESSAGE and size >= MESSAGE_HEAD:
                places[channel].append(place)
            elif opcode in (SCHEMA, CHANNEL):
                self._describe(opcode, chunk[place + HEAD : end])
            place = end
        return {channel: np.array(starts) for channel, starts in places.items()}


def bytes_at(buffer: NDArray[np.uint8], channel: int, places: IntArray) -> int:
    """Return the size of a channel's messages at `places` (k,) of a buffer; 0 if one is none."""
    if len(places) == 0 or places.min() < 0 or places.max() > len(buffer) - HEAD - MESSAGE_HEAD:
        return 0
    owner = buffer[places + HEAD] + 256 * buffer[places + HEAD + 1].astype(np.int64)
    sizes = integers(buffer, places + 1)
    whole = (sizes >= MESSAGE_HEAD) & (sizes <= len(buffer) - HEAD - places)
    whole &= (owner == channel) & (buffer[places] == MESSAGE)
    return int(np.sum(HEAD + sizes)) if whole.all() else 0


def integers(buffer: NDArray[np.uint8], offsets: IntArray) -> IntArray:
    """Return little-endian 64-bit integers at unaligned `offsets` (k,) of a buffer."""
    raw = buffer[offsets[:, None] + np.arange(8)]
    return np.asarray(raw.view("<i8")[:, 0], dtype=np.int64)
