"""The index at the end of an MCAP file: which chunks hold which topics, and where they lie."""

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

from idim_iv_ros.recording.bags.byte_source import READ_AHEAD, ByteSource
from idim_iv_ros.recording.bags.mcap_records import (
    CHUNK_INDEX,
    FOOTER,
    FOOTER_SIZE,
    HEAD,
    MAGIC,
    McapDescription,
    read_summary,
    records,
    summary_start,
)

# The end of a file that is fetched first: the summary of a minute of three topics is in it.
_TAIL = 1 << 14


class ChunkPlace(NamedTuple):
    """Where a chunk and the message indices behind it lie, and the channels that it holds."""

    first: int
    last: int
    channels: frozenset[int]


@dataclass(frozen=True)
class McapIndex:
    """What the summary of a file says of its content.

    Attributes
    ----------
    description : McapDescription
    counts : dict of channel to int
        Messages in the whole file.
    chunks : tuple of ChunkPlace
        In the order of the file.
    """

    description: McapDescription
    counts: dict[int, int]
    chunks: tuple[ChunkPlace, ...]

    def stretches(self, wanted: set[str]) -> Iterator[tuple[int, int]]:
        """Stretches of the file that hold the wanted topics: whole chunks, `READ_AHEAD` at once.

        Chunks between that hold none of them are not fetched.
        """
        own = {channel for channel, topic in self.description.channels.items() if topic in wanted}
        start = end = 0
        for chunk in self.chunks:
            if not chunk.channels & own:
                continue
            if end and (chunk.first != end or chunk.last - start > READ_AHEAD):
                yield start, end
                start = chunk.first
            elif not end:
                start = chunk.first
            end = chunk.last
        if end:
            yield start, end


def fetched_index(source: ByteSource) -> McapIndex | None:
    """Fetch the summary; None where the file has none, or one that does not find every message."""
    offset = max(0, source.size - _TAIL)
    tail = source.read(offset, source.size)
    start = summary_start(tail, offset)
    if start is None:
        return None
    if start < offset:
        tail = source.read(start, offset) + tail
        offset = start
    description = read_summary(tail, offset)
    if description is None or description.counts is None:
        return None
    chunks = _chunks(tail, start - offset, source.size - len(MAGIC) - FOOTER_SIZE - HEAD)
    # Messages outside chunks are in no index; neither are those of a writer that leaves it out.
    if chunks is None or (not chunks and any(description.counts.values())):
        return None
    return McapIndex(description, description.counts, chunks)


def _chunks(summary: bytes, place: int, last: int) -> tuple[ChunkPlace, ...] | None:
    """All chunk indices; None where one is damaged or names no channels."""
    chunks = []
    try:
        for record in records(summary, place):
            if record.opcode == FOOTER:
                break
            if record.opcode == CHUNK_INDEX:
                chunk = _chunk_place(summary[record.start : record.end])
                if not (chunk.first < chunk.last <= last and chunk.channels):
                    return None
                chunks.append(chunk)
    except struct.error:
        return None
    return tuple(sorted(chunks))


def _chunk_place(record: bytes) -> ChunkPlace:
    """From: first and last time, place, length, map of channels to indices, length of indices."""
    first, length, listed = struct.unpack_from("<QQI", record, 16)
    channels = [number for number, _ in struct.iter_unpack("<HQ", record[36 : 36 + listed])]
    (indices,) = struct.unpack_from("<Q", record, 36 + listed)
    return ChunkPlace(first, first + length + indices, frozenset(channels))
