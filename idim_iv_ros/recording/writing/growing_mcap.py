"""An MCAP file that is whole after every commit, whatever happens to the process afterwards."""

import os
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from idim_iv_ros.recording.writing.write import ShortChunkWriter, Storage, TopicChannel

Message = tuple[int, str, bytes, int, int]
"""Log time (ns), topic, serialised message, publish time (ns), sequence number."""


@dataclass(frozen=True)
class FileSummary:
    """One file of a bag.

    `name`: relative to the folder. `start`, `duration`: log time of the first message, and from
    there to the last, ns. `counts`: messages of each topic. `size`: bytes.
    """

    name: str
    start: int | None
    duration: int
    counts: Mapping[str, int]
    size: int

    @property
    def messages(self) -> int:
        """Messages in the file."""
        return sum(self.counts.values())


class GrowingMcap:
    """One MCAP file while it is recorded.

    Every commit writes the messages since the last one as compressed chunks, and behind them the
    summary and footer that a reader needs; the next commit overwrites these. A process that is
    killed leaves a file that any MCAP reader opens, without the messages after the last commit.
    A commit that fails leaves the file as it was, and keeps its messages for the next one.

    `path`: must not exist. `storage`: compression and size of the chunks. `counts`: messages of
    each topic that were added. `summary`: what is on disk.
    Raises OSError: the file cannot be made.
    """

    def __init__(self, path: Path, storage: Storage | None = None) -> None:
        self.path = path
        self.counts: dict[str, int] = {}
        self.summary = FileSummary(path.name, None, 0, {}, 0)
        self._first: int | None = None
        self._last: int | None = None
        self._channels: dict[str, int] = {}
        self._stream = _Stream()
        # Not the name alone: what a robot did cannot be made again, so nothing may replace it.
        self._writer = ShortChunkWriter(
            self._stream, library="idim_iv_ros recorder", summary_offsets=False, storage=storage
        )
        self._end = 0
        self._trailer = b""
        self._waiting = bytearray()
        self._open_chunk = 0
        self._file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o644)
        try:
            self.commit()
        except OSError:
            os.close(self._file)
            path.unlink(missing_ok=True)
            raise

    @property
    def waiting_bytes(self) -> int:
        """Bytes that were added and are not on disk."""
        return len(self._waiting) + self._open_chunk

    @property
    def waiting(self) -> int:
        """Messages that were added and are not on disk."""
        return sum(self.counts.values()) - self.summary.messages

    def describe(self, topic: TopicChannel) -> None:
        """Make a topic known; its messages may follow."""
        self._channels[topic.name] = topic.register(self._writer)
        self.counts[topic.name] = 0

    def knows(self, topic: str) -> bool:
        """Whether a topic was described."""
        return topic in self._channels

    def add(self, messages: Iterable[Message]) -> None:
        """Take messages of described topics."""
        add_message, channels, counts = self._writer.add_message, self._channels, self.counts
        size = 0
        for log_time, topic, data, publish_time, sequence in messages:
            add_message(channels[topic], log_time, data, publish_time, sequence & 0xFFFFFFFF)
            counts[topic] += 1
            size += len(data)
            if self._first is None or log_time < self._first:
                self._first = log_time
            if self._last is None or log_time > self._last:
                self._last = log_time
        self._open_chunk += size

    def commit(self, announce: Callable[[FileSummary], None] | None = None) -> None:
        """Put everything that was added on disk.

        `announce` takes what the file will hold, just before it does; it may raise OSError, too.
        Raises OSError: it could not be written; the file is as before, and nothing that was added
        is lost.
        """
        self._writer.flush()
        self._waiting += self._stream.take()
        self._open_chunk = 0
        body = self._stream.position
        self._writer.finish()  # type: ignore[no-untyped-call]
        trailer = self._stream.take()
        self._stream.position = body
        content = bytes(self._waiting) + trailer
        summary = self._summary(self._end + len(content))
        if announce is not None:
            announce(summary)
        try:
            self._put(content)
        except OSError:
            with suppress(OSError):
                self._put(self._trailer)
            raise
        self._end += len(self._waiting)
        self._trailer = trailer
        self._waiting.clear()
        self.summary = summary

    def _summary(self, size: int) -> FileSummary:
        if self._first is None or self._last is None:
            return FileSummary(self.path.name, None, 0, dict(self.counts), size)
        duration = self._last - self._first
        return FileSummary(self.path.name, self._first, duration, dict(self.counts), size)

    def close(self) -> None:
        """Give the file up; what was committed stays."""
        os.close(self._file)

    def _put(self, content: bytes) -> None:
        """Write behind the last chunk, over the old summary."""
        view, place = memoryview(content), self._end
        while view:
            written = os.pwrite(self._file, view, place)
            view, place = view[written:], place + written
        os.ftruncate(self._file, self._end + len(content))
        os.fsync(self._file)


class _Stream:
    """What the writer writes into: bytes until they are taken, at their place in the file."""

    def __init__(self) -> None:
        self.position = 0
        self._content = bytearray()

    def write(self, content: bytes) -> int:
        self._content += content
        self.position += len(content)
        return len(content)

    def tell(self) -> int:
        return self.position

    def flush(self) -> None:
        """Nothing waits here that is not taken at the next commit."""

    def take(self) -> bytes:
        content = bytes(self._content)
        self._content.clear()
        return content
