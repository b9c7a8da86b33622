"""Records of an MCAP file, and its summary. See https://mcap.dev/spec."""

import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from io import BytesIO
from mmap import mmap
from typing import NamedTuple

from mcap.data_stream import ReadDataStream
from mcap.exceptions import EndOfFile
from mcap.records import Channel, ChunkIndex, Schema, Statistics

from idim_iv_ros.recording.bags.bag_file import READ_AHEAD, ByteSource
from idim_iv_ros.recording.bags.definitions import SchemaText, note_type

DAMAGED = 0  # no opcode of the format: bytes that are no record
FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, STATISTICS, DATA_END = 2, 3, 4, 5, 6, 11, 15
CHUNK_INDEX = 8
HEAD = 9  # opcode and length
MESSAGE_HEAD = 22  # channel, sequence, log time, publish time
_LAST_OPCODE, _FIRST_PRIVATE = 15, 0x80

MAGIC = b"\x89MCAP0\r\n"
FOOTER_SIZE = 20
DAMAGED_CONTENT = (struct.error, UnicodeDecodeError, EndOfFile)
"""What the content of a damaged record raises."""

_LONGEST_SUMMARY = 1 << 28
# The end of a file that is read first: the summary of a minute of three topics is in it.
_TAIL = 1 << 14


class Record(NamedTuple):
    """One record: what it is, and where its content lies; `end` may pass the end of the file."""

    opcode: int
    start: int
    end: int


def records(content: mmap | bytes, place: int) -> Iterator[Record]:
    """Records from `place` on, up to one whose head contradicts itself, given as ``DAMAGED``.

    The last one passes the end of a file that was cut.
    """
    while place + HEAD <= len(content):
        record = _record(content, place)
        yield record
        if record.opcode == DAMAGED:
            return
        place = record.end


def _record(content: mmap | bytes, place: int) -> Record:
    """Record at `place`."""
    opcode, size = struct.unpack_from("<BQ", content, place)
    record = Record(opcode, place + HEAD, place + HEAD + size)
    if opcode == CHUNK:
        whole = _is_chunk(content, record)
    elif opcode == MESSAGE:
        whole = size >= MESSAGE_HEAD
    elif opcode == DATA_END:
        whole = size == 4
    elif opcode == FOOTER:
        whole = size == 20
    else:
        whole = 0 < opcode <= _LAST_OPCODE or opcode >= _FIRST_PRIVATE
    return record if whole else record._replace(opcode=DAMAGED)


def _is_chunk(content: mmap | bytes, record: Record) -> bool:
    """Whether the length of a chunk is that of its parts."""
    if record.start + 40 > len(content):
        return False
    (name,) = struct.unpack_from("<I", content, record.start + 28)
    if name > 16 or record.start + 40 + name > len(content):
        return False
    (size,) = struct.unpack_from("<Q", content, record.start + 32 + name)
    return bool(record.end - record.start == 40 + name + size)


@dataclass
class McapDescription:
    """Schemas and channels of a file, from its data or from its summary.

    `schemas`: name of each schema. `definitions`: definition of each type. `channels`: topic of
    each channel of CDR messages. `topics`: type of each topic. `counts`: messages of each channel
    in the whole file; None where no summary says it. `chunks`: where chunks lie, and which channels
    they hold.
    """

    schemas: dict[int, str] = field(default_factory=dict)
    definitions: dict[str, SchemaText] = field(default_factory=dict)
    channels: dict[int, str] = field(default_factory=dict)
    topics: dict[str, str] = field(default_factory=dict)
    counts: dict[int, int] | None = None
    chunks: list[ChunkIndex] = field(default_factory=list)

    def add(self, opcode: int, content: bytes) -> None:
        """Take the content of a record of a schema, of a channel, or of the summary.

        Raises one of `DAMAGED_CONTENT` if it is damaged.
        """
        stream = ReadDataStream(BytesIO(content))
        if opcode == SCHEMA:
            schema = Schema.read(stream)
            self.schemas[schema.id] = schema.name
            # Other encodings than those of ROS need not be text.
            text = schema.data.decode("utf-8", errors="replace")
            self.definitions[schema.name] = SchemaText(schema.encoding, text)
        elif opcode == CHANNEL:
            channel = Channel.read(stream)
            if channel.message_encoding == "cdr":
                self.channels[channel.id] = channel.topic
                note_type(self.topics, channel.topic, self.schemas.get(channel.schema_id, ""))
        elif opcode == STATISTICS:
            self.counts = dict(Statistics.read(stream).channel_message_counts)
        elif opcode == CHUNK_INDEX:
            self.chunks.append(ChunkIndex.read(stream))

    def lists_every_message(self, size: int) -> bool:
        """Whether chunks that are listed hold all messages of a file of `size` bytes.

        Messages outside chunks are in no index; neither are those of a writer that leaves it out.
        """
        last = size - len(MAGIC) - FOOTER_SIZE - HEAD
        return (
            self.counts is not None
            and (bool(self.chunks) or not any(self.counts.values()))
            and all(
                chunk.message_index_offsets
                and chunk.chunk_length + chunk.message_index_length
                <= last - chunk.chunk_start_offset
                for chunk in self.chunks
            )
        )

    def stretches(self, wanted: set[str]) -> Iterator[list[tuple[int, int]]]:
        """Places of the chunks that hold the wanted topics, those to be read at once together.

        They follow one another without a gap, and are `READ_AHEAD` together if they are several.
        """
        channels = {channel for channel, topic in self.channels.items() if topic in wanted}
        together: list[tuple[int, int]] = []
        for chunk in sorted(self.chunks, key=lambda chunk: chunk.chunk_start_offset):
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


def read_summary(source: ByteSource) -> McapDescription | None:
    """Description at the end of a file, None where there is none or its checksum is wrong."""
    offset = max(0, source.size - _TAIL)
    tail = source.read(offset, source.size)
    footer = len(tail) - len(MAGIC) - FOOTER_SIZE
    if footer < HEAD or tail[-len(MAGIC) :] != MAGIC or tail[footer - HEAD] != FOOTER:
        return None
    start, _, checksum = struct.unpack_from("<QQI", tail, footer)
    length = offset + footer - HEAD - start
    if start < len(MAGIC) or not 0 < length <= _LONGEST_SUMMARY:
        return None
    if start < offset:
        tail, offset = source.read(start, offset) + tail, start
    # A writer that computes no checksum leaves it zero.
    if checksum not in (0, zlib.crc32(tail[start - offset : -len(MAGIC) - 4])):
        return None
    description = McapDescription()
    try:
        for record in records(tail, start - offset):
            if record.opcode == FOOTER:
                break
            description.add(record.opcode, tail[record.start : record.end])
    except DAMAGED_CONTENT:
        return None
    return description
