"""What an MCAP file says of its content, and where its chunks lie."""

import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from io import BytesIO

from mcap.data_stream import ReadDataStream
from mcap.exceptions import EndOfFile
from mcap.records import Channel, ChunkIndex, Schema, Statistics

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
)

DAMAGED_CONTENT = (struct.error, UnicodeDecodeError, EndOfFile)
"""What the content of a damaged record raises."""

_LONGEST_SUMMARY = 1 << 28
# The end of a file that is read first: the summary of a minute of three topics is in it.
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
    chunks : list of ChunkIndex
        Where chunks lie, and which channels they hold.
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
