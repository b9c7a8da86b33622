"""What the summary at the end of an MCAP file says of its content, and where its chunks lie."""

import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from io import BytesIO
from mmap import mmap

from mcap.data_stream import ReadDataStream
from mcap.exceptions import EndOfFile
from mcap.records import ChunkIndex, Statistics

from idim_iv_ros.recording.bags.bag_file import READ_AHEAD, ByteSource
from idim_iv_ros.recording.bags.definitions import SchemaText, note_type
from idim_iv_ros.recording.bags.mcap_records import (
    CHANNEL,
    CHUNK_INDEX,
    FOOTER,
    FOOTER_SIZE,
    HEAD,
    MAGIC,
    SCHEMA,
    STATISTICS,
    records,
    text,
)

_LONGEST_SUMMARY = 1 << 28
# The end of a file that is fetched first: the summary of a minute of three topics is in it.
_TAIL = 1 << 14


@dataclass
class McapDescription:
    """Schemas and channels of a file, from its data or from its summary.

    Attributes
    ----------
    schemas : dict
        Name of each schema.
    definitions : dict
        Definition of each type.
    channels : dict
        Topic of each channel of CDR messages.
    topics : dict
        Type of each topic.
    counts : dict or None
        Messages of each channel in the whole file; None where no summary says it.
    chunks : list of bytes
        Records of the summary that say where chunks lie.
    """

    schemas: dict[int, str] = field(default_factory=dict)
    definitions: dict[str, SchemaText] = field(default_factory=dict)
    channels: dict[int, str] = field(default_factory=dict)
    topics: dict[str, str] = field(default_factory=dict)
    counts: dict[int, int] | None = None
    chunks: list[bytes] = field(default_factory=list)

    def add(self, opcode: int, record: bytes) -> None:
        """Take a record of a schema, of a channel, or of the summary.

        Raises
        ------
        struct.error, UnicodeDecodeError, EndOfFile
            It is damaged.
        """
        if opcode == SCHEMA:
            (number,) = struct.unpack_from("<H", record)
            name, place = text(record, 2)
            self.schemas[number] = name
            encoding, place = text(record, place)
            # Other encodings than those of ROS need not be text.
            written = record[place + 4 :].decode("utf-8", errors="replace")
            self.definitions[name] = SchemaText(encoding, written)
        elif opcode == CHANNEL:
            number, schema = struct.unpack_from("<HH", record)
            topic, place = text(record, 4)
            encoding, _ = text(record, place)
            if encoding == "cdr":
                self.channels[number] = topic
                note_type(self.topics, topic, self.schemas.get(schema, ""))
        elif opcode == STATISTICS:
            statistics = Statistics.read(ReadDataStream(BytesIO(record)))
            self.counts = dict(statistics.channel_message_counts)
        elif opcode == CHUNK_INDEX:
            self.chunks.append(record)

    def stretches(self, wanted: set[str]) -> Iterator[tuple[int, int]]:
        """Stretches of the file that hold the wanted topics: whole chunks, `READ_AHEAD` at once.

        Chunks between that hold none of them are not fetched.
        """
        channels = {channel for channel, topic in self.channels.items() if topic in wanted}
        start = end = 0
        for chunk in sorted(_chunk_indices(self), key=lambda chunk: chunk.chunk_start_offset):
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


def read_summary(content: mmap | bytes, offset: int = 0) -> McapDescription | None:
    """Description at the end of a file, None where there is none or its checksum is wrong.

    `content` is the end of the file from byte `offset` on; it must hold the whole summary.
    """
    footer = len(content) - len(MAGIC) - FOOTER_SIZE
    start = _summary_start(content, offset)
    if start is None or start < offset:
        return None
    start -= offset
    (checksum,) = struct.unpack_from("<I", content, footer + 16)
    # A writer that computes no checksum leaves it zero.
    if checksum not in (0, zlib.crc32(content[start : footer + 16])):
        return None
    description = McapDescription()
    try:
        for record in records(content, start):
            if record.opcode == FOOTER:
                break
            description.add(record.opcode, content[record.start : record.end])
    except (struct.error, UnicodeDecodeError, EndOfFile):
        return None
    return description


def fetched_summary(source: ByteSource) -> McapDescription | None:
    """Fetch the summary; None where the file has none, or one that does not find every message."""
    offset = max(0, source.size - _TAIL)
    tail = source.read(offset, source.size)
    start = _summary_start(tail, offset)
    if start is None:
        return None
    if start < offset:
        tail = source.read(start, offset) + tail
        offset = start
    description = read_summary(tail, offset)
    if description is None or description.counts is None:
        return None
    last = source.size - len(MAGIC) - FOOTER_SIZE - HEAD
    try:
        chunks = list(_chunk_indices(description))
    except (struct.error, UnicodeDecodeError, EndOfFile):
        return None
    whole = all(
        chunk.message_index_offsets
        and chunk.chunk_length + chunk.message_index_length <= last - chunk.chunk_start_offset
        for chunk in chunks
    )
    # Messages outside chunks are in no index; neither are those of a writer that leaves it out.
    if not whole or (not description.chunks and any(description.counts.values())):
        return None
    return description


def _chunk_indices(description: McapDescription) -> Iterator[ChunkIndex]:
    return (ChunkIndex.read(ReadDataStream(BytesIO(record))) for record in description.chunks)


def _summary_start(content: mmap | bytes, offset: int) -> int | None:
    """Where in the file the summary begins, None where there is none; see `read_summary`."""
    footer = len(content) - len(MAGIC) - FOOTER_SIZE
    if footer < HEAD or content[-len(MAGIC) :] != MAGIC or content[footer - HEAD] != FOOTER:
        return None
    (start,) = struct.unpack_from("<Q", content, footer)
    if offset + footer - start > _LONGEST_SUMMARY:
        return None
    return start if len(MAGIC) <= start < offset + footer - HEAD else None
