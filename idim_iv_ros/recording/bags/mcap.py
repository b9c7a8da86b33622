"""MCAP files chunk by chunk: raw messages found by their index, no object for each message.

Records are walked from the start of the file, so that a file without summary, with a torn end or
with damaged records is read as far as it goes. Of a file that is far away (`ByteSource`) only the
summary and the chunks that hold wanted topics are fetched, and walked by the same code.
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
from idim_iv_ros.recording.bags.bag_file import BagFile, ByteSource, copied
from idim_iv_ros.recording.bags.cdr import MessageBatch
from idim_iv_ros.recording.bags.mcap_records import (
    CHANNEL,
    CHUNK,
    DAMAGED,
    DATA_END,
    FOOTER,
    HEAD,
    INDEX,
    MAGIC,
    MESSAGE,
    MESSAGE_HEAD,
    SCHEMA,
    Record,
    records,
    text,
)
from idim_iv_ros.recording.bags.mcap_summary import McapDescription, fetched_summary, read_summary
from idim_iv_ros.types import IntArray

_READ = (CHUNK, INDEX, MESSAGE, SCHEMA, CHANNEL)
_LARGEST_CHUNK = 1 << 30
_LARGEST_DESCRIPTION = 1 << 24
_LOOSE_TOGETHER, _LOOSE_BYTES = 10_000, 1 << 26  # messages, and what they span
_FORGOTTEN = 1 << 26  # bytes of a file that stay in memory behind the place of reading


@dataclass
class McapFile(BagFile):
    """One MCAP file.

    Attributes
    ----------
    source : ByteSource or None
        Where the bytes are if not on this machine.
    """

    source: ByteSource | None = None
    _description: McapDescription = field(default_factory=McapDescription)
    _found: Counter[int] = field(default_factory=Counter)

    def batches(self, wanted: set[str]) -> Iterator[tuple[str, MessageBatch]]:
        """Raw messages of the wanted topics, chunk by chunk; otherwise as `BagFile`."""
        if self.source is not None:
            summary = fetched_summary(self.source)
            if summary is not None:
                yield from self._fetched(summary, self.source, wanted)
                return
        with self._mapped() as (content, file):
            if MAGIC not in (content[: len(MAGIC)], content[-len(MAGIC) :]):
                raise DataError(f"{self.path}: not an MCAP file")
            summary = read_summary(content)
            self._use(summary or McapDescription())
            yield from self._walk(content, wanted, len(MAGIC), file)
            if summary is not None and summary.counts is not None:
                self._compare(summary.counts, wanted)

    def summarised_topics(self) -> dict[str, str]:
        """Type of each topic by the summary; empty where the file has none."""
        if self.source is not None:
            summary = fetched_summary(self.source)
        else:
            with self._mapped() as (content, _):
                summary = read_summary(content)
        return {} if summary is None else dict(summary.topics)

    @contextmanager
    def _mapped(self) -> Iterator[tuple[mmap.mmap, int]]:
        """Content of the file in memory as it is touched, and the descriptor of the file.

        What is far away is copied to a file.

        Only a whole file can be searched for what is left of it when its index is missing.
        """
        with copied(self.source) if self.source is not None else self.path.open("rb") as file:
            if file.seek(0, 2) == 0:
                raise DataError(f"{self.path}: the file is empty")
            with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
                yield content, file.fileno()

    def _fetched(
        self, summary: McapDescription, source: ByteSource, wanted: set[str]
    ) -> Iterator[tuple[str, MessageBatch]]:
        """Messages of the chunks that hold wanted topics, some chunks at a time."""
        self._use(summary)
        for first, last in summary.stretches(wanted):
            yield from self._walk(source.read(first, last), wanted, 0)
        self.truncated = False
        self._compare(summary.counts or {}, wanted)

    def _use(self, description: McapDescription) -> None:
        self._description = description
        self.topics, self.definitions = description.topics, description.definitions

    def _walk(
        self,
        content: mmap.mmap | bytes,
        wanted: set[str],
        place: int,
        file: int | None = None,
    ) -> Iterator[tuple[str, MessageBatch]]:
        # A chunk is followed by its indices.
        chunk: bytes | None = None
        indices: dict[int, IntArray] = {}
        loose: list[Record] = []
        self.truncated = True
        read = 0
        for record in records(content, place, file):
            opcode, start, end = record
            if start - read > _FORGOTTEN and isinstance(content, mmap.mmap):
                content.madvise(mmap.MADV_DONTNEED, read, _FORGOTTEN)
                read += _FORGOTTEN
            if opcode != INDEX:
                yield from self._chunk(chunk, indices, wanted)
                chunk, indices = None, {}
            if opcode in (FOOTER, DATA_END):
                self.truncated = False
                break
            largest = _LARGEST_DESCRIPTION if opcode in (SCHEMA, CHANNEL) else _LARGEST_CHUNK
            if opcode == DAMAGED or (opcode in _READ and end - start > largest):
                self._lose()
            elif opcode == CHUNK:
                chunk = self._decompress(content[start:end], torn=end > len(content))
            elif end > len(content):
                break
            elif opcode in (SCHEMA, CHANNEL):
                self._describe(opcode, content[start:end])
            elif opcode == INDEX:
                self._index(content[start:end], indices)
            elif opcode == MESSAGE:
                loose.append(record)
                if len(loose) >= _LOOSE_TOGETHER or end - loose[0].start > _LOOSE_BYTES:
                    yield from self._loose(content, loose, wanted)
                    loose = []
        yield from self._chunk(chunk, indices, wanted)
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
        except (struct.error, UnicodeDecodeError):
            self._lose()

    def _decompress(self, record: bytes, *, torn: bool) -> bytes | None:
        """Content of a chunk, None (and counted) where it is damaged; of a torn one its start."""
        try:
            size, checksum = struct.unpack_from("<QI", record, 16)
            compression, place = text(record, 28)
            payload = record[place + 8 :]
            if size > _LARGEST_CHUNK:
                raise ValueError("the chunk is too large")
            if torn:
                return start_of(payload, compression, size)
            if compression == "zstd":
                content = zstandard.ZstdDecompressor().decompress(payload, max_output_size=size)
            elif compression == "lz4":
                content = bytes(lz4.frame.LZ4FrameDecompressor().decompress(payload, size))
            else:
                content = payload
            if checksum not in (0, zlib.crc32(content)):
                raise ValueError("wrong checksum")
        except (
            struct.error,
            ValueError,
            RuntimeError,
            EOFError,
            MemoryError,
            zstandard.ZstdError,
        ):
            self._lose()
            return None
        return content

    def _index(self, record: bytes, indices: dict[int, IntArray]) -> None:
        (channel,) = struct.unpack_from("<H", record)
        entries = np.frombuffer(record, dtype="<i8", offset=6).reshape(-1, 2)
        indices[channel] = entries[:, 1]

    def _chunk(
        self, chunk: bytes | None, indices: dict[int, IntArray], wanted: set[str]
    ) -> Iterator[tuple[str, MessageBatch]]:
        """Messages of a chunk: those of its indices, and what lies between them."""
        if chunk is None:
            for channel, offsets in indices.items():
                if self._description.channels.get(channel) in wanted:
                    self.missing[self._description.channels[channel]] += len(offsets)
            return
        buffer = np.frombuffer(chunk, dtype=np.uint8)
        whole: list[tuple[int, IntArray, IntArray]] = []
        for channel, offsets in indices.items():
            sizes = message_sizes(buffer, channel, offsets)
            if sizes is not None:
                whole.append((channel, offsets, sizes))
        between = stretches_between(whole, len(chunk))
        if between:
            for channel, places in self._scan(chunk, between).items():
                offsets = np.array(places)
                whole.append((channel, offsets, integers(buffer, offsets + 1)))
        for channel, offsets, sizes in whole:
            topic = self._description.channels.get(channel)
            self._found[channel] += len(offsets)
            if topic in wanted and len(offsets):
                yield topic, message_batch(buffer, offsets, sizes)

    def _scan(self, chunk: bytes, stretches: list[tuple[int, int]]) -> dict[int, list[int]]:
        """Walk the records in stretches of a chunk that no index names."""
        places: dict[int, list[int]] = {}
        for place, last in stretches:
            while place + HEAD <= last:
                opcode, size = struct.unpack_from("<BQ", chunk, place)
                start, end = place + HEAD, place + HEAD + size
                if end > last:
                    break
                if opcode in (SCHEMA, CHANNEL):
                    self._describe(opcode, chunk[start:end])
                elif opcode == MESSAGE and size >= MESSAGE_HEAD:
                    (channel,) = struct.unpack_from("<H", chunk, start)
                    places.setdefault(channel, []).append(place)
                place = end
        return places

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
            topic = self._description.channels.get(channel)
            self._found[channel] += len(starts)
            if topic in wanted:
                offsets = np.array(starts)
                yield topic, message_batch(buffer, offsets, integers(buffer, offsets + 1))

    def _compare(self, counts: dict[int, int], wanted: set[str]) -> None:
        """Count what is missing against the summary."""
        self.missing.clear()
        self.counted = True
        for channel, topic in self._description.channels.items():
            if topic in wanted:
                self.missing[topic] += max(0, counts.get(channel, 0) - self._found[channel])


def start_of(payload: bytes, compression: str, size: int) -> bytes | None:
    """What can be decompressed of a chunk whose end is missing."""
    if compression == "zstd":
        return zstandard.ZstdDecompressor().decompressobj().decompress(payload)[:size]
    if compression == "lz4":
        return bytes(lz4.frame.LZ4FrameDecompressor().decompress(payload, size))
    return payload


def message_sizes(buffer: NDArray[np.uint8], channel: int, offsets: IntArray) -> IntArray | None:
    """Sizes of the messages that an index names; None if it names anything else."""
    if len(offsets) == 0:
        return np.zeros(0, dtype=np.int64)
    last = len(buffer) - HEAD - MESSAGE_HEAD
    if offsets.min() < 0 or offsets.max() > last or np.any(buffer[offsets] != MESSAGE):
        return None
    owner = buffer[offsets + HEAD] + 256 * buffer[offsets + HEAD + 1].astype(np.int64)
    sizes = integers(buffer, offsets + 1)
    whole = (sizes >= MESSAGE_HEAD) & (sizes <= len(buffer) - HEAD - offsets)
    return sizes if np.all(whole & (owner == channel)) else None


def stretches_between(
    whole: list[tuple[int, IntArray, IntArray]], length: int
) -> list[tuple[int, int]]:
    """Stretches of a chunk of so many bytes that belong to no message of an index."""
    if sum(int(sizes.sum()) + HEAD * len(sizes) for _, _, sizes in whole) == length:
        return []
    starts = np.concatenate([np.zeros(0, np.int64), *(offsets for _, offsets, _ in whole)])
    ends = np.concatenate([np.zeros(0, np.int64), *(o + HEAD + s for _, o, s in whole)])
    order = np.argsort(starts)
    begins = np.concatenate([[0], ends[order]])
    stops = np.concatenate([starts[order], [length]])
    return [(int(begins[k]), int(stops[k])) for k in np.flatnonzero(stops - begins >= HEAD)]


def message_batch(buffer: NDArray[np.uint8], offsets: IntArray, sizes: IntArray) -> MessageBatch:
    """Batch of the message records at `offsets` whose contents have `sizes` bytes."""
    return MessageBatch(
        buffer=buffer,
        offsets=offsets + HEAD + MESSAGE_HEAD,
        sizes=sizes - MESSAGE_HEAD,
        arrival=integers(buffer, offsets + HEAD + 6),
    )


def integers(buffer: NDArray[np.uint8], offsets: IntArray) -> IntArray:
    """Little-endian 64-bit integers at unaligned places."""
    raw = buffer[offsets[:, None] + np.arange(8)]
    return np.asarray(raw.view("<i8")[:, 0], dtype=np.int64)
