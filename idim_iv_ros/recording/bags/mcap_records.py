"""Records of an MCAP file, walked past damaged ones, and its summary. See https://mcap.dev/spec."""

import errno
import os
import re
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
FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, INDEX, STATISTICS, DATA_END = 2, 3, 4, 5, 6, 7, 11, 15
CHUNK_INDEX = 8
HEAD = 9  # opcode and length
MESSAGE_HEAD = 22  # channel, sequence, log time, publish time
_LAST_OPCODE, _FIRST_PRIVATE = 15, 0x80

# A chunk by its compression, which is found 37 bytes behind its opcode; a message by its length.
_BEGINNINGS = re.compile(
    rb"\x06.{5}\0{3}.{28}(?:\x04\0{3}zstd|\x03\0{3}lz4|\0{4})|\x05.{2}\0{6}", re.DOTALL
)
_LONGEST_BEGINNING = 64  # bytes of the longest match, and some more
_IN_A_ROW = 3  # records that must follow each other where reading begins again
# Bytes that are no record: a file that holds so many more of them than of records is given up, for
# no recorder left it like that. Zeros, which a hole on the disk is made of, are passed by unread.
_MOST_GARBAGE, _BLOCK = 1 << 27, 1 << 20
_ZEROS = bytes(_BLOCK)

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


def records(content: mmap | bytes, place: int, file: int | None = None) -> Iterator[Record]:
    """Records from `place` on.

    What is no record, because a byte of its head or of the one before is wrong, is given as
    ``DAMAGED``; reading goes on at the next record that can be recognised. The last one passes the
    end of a file that was cut. `file` is the descriptor of the file: its holes take no time then.
    """
    trusted, begin = place, place
    garbage = 0
    while place + HEAD <= len(content):
        record = _record(content, place)
        if record is not None and record.end <= len(content):
            yield record
            # The length of a chunk is written in it twice; any other may have led astray.
            trusted = record.end if record.opcode == CHUNK else record.start
            place = record.end
            continue
        most = _MOST_GARBAGE + place - begin - garbage
        following, passed = _next_beginning(content, file, trusted, most)
        garbage += passed
        if following is None:
            if record is not None:
                yield record
            return
        yield Record(DAMAGED, place, following)
        trusted = place = following


def _record(content: mmap | bytes, place: int) -> Record | None:
    """Record at `place`, None where its head contradicts itself."""
    opcode, size = struct.unpack_from("<BQ", content, place)
    record = Record(opcode, place + HEAD, place + HEAD + size)
    if opcode == CHUNK:
        whole = _is_chunk(content, record)
    elif opcode == INDEX:
        whole = size >= 6 and (size - 6) % 16 == 0
    elif opcode == MESSAGE:
        whole = size >= MESSAGE_HEAD
    elif opcode == DATA_END:
        whole = size == 4
    elif opcode == FOOTER:
        whole = size == 20
    else:
        whole = 0 < opcode <= _LAST_OPCODE or opcode >= _FIRST_PRIVATE
    return record if whole else None


def _is_chunk(content: mmap | bytes, record: Record) -> bool:
    """Whether the length of a chunk is that of its parts."""
    if record.start + 40 > len(content):
        return False
    (name,) = struct.unpack_from("<I", content, record.start + 28)
    if name > 16 or record.start + 40 + name > len(content):
        return False
    (size,) = struct.unpack_from("<Q", content, record.start + 32 + name)
    return bool(record.end - record.start == 40 + name + size)


def _next_beginning(
    content: mmap | bytes, file: int | None, place: int, most: int
) -> tuple[int | None, int]:
    """Where the next record begins that others follow, and the bytes before it that are no zeros.

    No place is returned if none follows, or only behind more than `most` such bytes.
    """
    garbage = 0
    while place < len(content):
        if file is not None:
            try:  # a hole is passed by: no record begins with a zero
                place = os.lseek(file, place, os.SEEK_DATA)
            except OSError as error:
                # Other errors come from file systems that do not know their holes.
                if error.errno == errno.ENXIO:
                    break
        end = min(place + _BLOCK, len(content))
        block = content[place:end]
        if block != _ZEROS[: len(block)]:
            beyond = min(end + _LONGEST_BEGINNING, len(content))
            for match in _BEGINNINGS.finditer(content, place, beyond):
                beginning = match.start()
                if beginning < end and _leads_on(content, beginning):
                    return beginning, garbage + beginning - place
            garbage += len(block)
            if garbage > most:
                break
        place = end
    return None, garbage


def _leads_on(content: mmap | bytes, place: int) -> bool:
    for _ in range(_IN_A_ROW):
        if place + HEAD > len(content):
            break
        record = _record(content, place)
        if record is None or record.end > len(content):
            return False
        if record.opcode == FOOTER:
            break
        place = record.end
    return True


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

    def stretches(self, wanted: set[str]) -> Iterator[tuple[int, int]]:
        """Stretches of the file that hold the wanted topics: whole chunks, `READ_AHEAD` at once.

        Chunks between that hold none of them are not read.
        """
        channels = {channel for channel, topic in self.channels.items() if topic in wanted}
        start = end = 0
        for chunk in sorted(self.chunks, key=lambda chunk: chunk.chunk_start_offset):
            if channels.isdisjoint(chunk.message_index_offsets):
                continue
            first = chunk.chunk_start_offset
            last = first + chunk.chunk_length + chunk.message_index_length
            if first != end or last - start > READ_AHEAD:
                if end:
                    yield start, end
                start = first
            end = last
        if end:
            yield start, end


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
