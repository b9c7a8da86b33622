"""A rosbag2 folder while it is recorded: successive files, and metadata kept up to date.

Each file is complete after every commit, whatever happens to the process afterwards.
"""

import json
import os
import shutil
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path

from idim_iv_ros.files import write_together
from idim_iv_ros.recording.writing.write import PRESETS, ShortChunkWriter, Storage, TopicChannel

Message = tuple[int, str, bytes, int, int]
"""Log time (ns), topic, serialised message, publish time (ns), sequence number."""


@dataclass(frozen=True)
class FileSummary:
    """Summary of one file of a bag."""

    name: str  # relative to the folder
    start: int | None  # log time of the first message, ns
    duration: int  # from there to the last, ns
    counts: Mapping[str, int]  # number of messages of each topic
    size: int  # bytes

    @property
    def messages(self) -> int:
        """Return the number of messages in the file."""
        return sum(self.counts.values())


class GrowingMcap:
    """One MCAP file while it is recorded.

    Every commit writes the new messages as compressed chunks, and behind them the summary and
    footer that a reader needs, which the next commit overwrites. A killed process leaves a file
    that any MCAP reader opens, without the messages after the last commit. A commit that fails
    leaves the file as it was, and keeps its messages for the next one.

    `path`: must not exist. `storage`: compression and size of the chunks. `counts`: number of
    messages added to each topic. `summary`: content on disk.

    Raises OSError: the file cannot be made.
    """

    def __init__(self, path: Path, storage: Storage = PRESETS["default"]) -> None:
        self.path = path
        self.counts: dict[str, int] = {}
        self.summary = FileSummary(path.name, None, 0, {}, 0)
        self._span: tuple[int, int] | None = None  # first and last log time
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
        """Return the bytes that were added and are not on disk."""
        return len(self._waiting) + self._open_chunk

    @property
    def waiting(self) -> int:
        """Return the number of messages that were added and are not on disk."""
        return sum(self.counts.values()) - self.summary.messages

    def describe(self, topic: TopicChannel) -> None:
        """Add a topic; its messages may follow."""
        self._channels[topic.name] = topic.register(self._writer)
        self.counts[topic.name] = 0

    def add(self, messages: Iterable[Message]) -> None:
        """Add messages of described topics."""
        add_message, channels, counts = self._writer.add_message, self._channels, self.counts
        for log_time, topic, data, publish_time, sequence in messages:
            add_message(channels[topic], log_time, data, publish_time, sequence & 0xFFFFFFFF)
            counts[topic] += 1
            self._open_chunk += len(data)
            first, last = self._span or (log_time, log_time)
            self._span = min(first, log_time), max(last, log_time)

    def commit(self, announce: Callable[[FileSummary], None] | None = None) -> None:
        """Write all added messages to disk.

        `announce` takes the new summary just before it is written; it may raise OSError, too.

        Raises OSError: it could not be written; the file is as before, and no message is lost.
        """
        self._writer.flush()
        self._waiting += self._stream.take()
        self._open_chunk = 0
        body = self._stream.begin
        self._writer.finish()  # type: ignore[no-untyped-call]
        trailer = self._stream.take()
        self._stream.begin = body
        content = bytes(self._waiting) + trailer
        first, last = self._span or (None, None)
        duration = 0 if first is None or last is None else last - first
        size = self._end + len(content)
        summary = FileSummary(self.path.name, first, duration, dict(self.counts), size)
        if announce is not None:
            announce(summary)
        try:
            self._overwrite_summary(content)
        except OSError:
            with suppress(OSError):
                self._overwrite_summary(self._trailer)
            raise
        self._end += len(self._waiting)
        self._trailer = trailer
        self._waiting.clear()
        self.summary = summary

    def close(self) -> None:
        """Close the file; messages that were not committed are lost."""
        os.close(self._file)

    def _overwrite_summary(self, content: bytes) -> None:
        view, place = memoryview(content), self._end
        while view:
            written = os.pwrite(self._file, view, place)
            view, place = view[written:], place + written
        os.ftruncate(self._file, self._end + len(content))
        os.fsync(self._file)


class _Stream(BytesIO):
    """Memory stream for the MCAP writer that counts bytes as at their place in the file."""

    def __init__(self) -> None:
        super().__init__()
        self.begin = 0

    def tell(self) -> int:
        """Return the place in the file."""
        return self.begin + super().tell()

    def take(self) -> bytes:
        """Return and drop the bytes written so far; the next ones follow them in the file."""
        content = self.getvalue()
        self.seek(0)
        self.truncate()
        self.begin += len(content)
        return content


@dataclass(frozen=True)
class ClosedBag:
    """A bag that is complete on disk, but for `lost` messages that were never written."""

    folder: Path
    files: tuple[FileSummary, ...]
    lost: int = 0


@dataclass(eq=False, repr=False)
class GrowingBag:
    """One bag while it is recorded.

    A commit updates metadata.yaml just before the file, so that the file never holds more than the
    metadata says, and what a crash between the two loses can be counted.

    Raises OSError: the folder or its first file cannot be made.
    """

    folder: Path  # made here; must not exist
    # Returns log time, ns, to stamp repeated messages with; zero while unknown (they wait for it).
    clock: Callable[[], int] = time.time_ns
    latched: dict[str, Message] = field(default_factory=dict)  # last ones of latched topics
    topics: dict[str, TopicChannel] = field(default_factory=dict)  # by name
    storage: Storage = PRESETS["default"]
    max_size: int = 0  # bytes of a file, after which a commit begins a new one; 0: never
    max_duration: float = 0.0  # s for which a file was written, likewise

    def __post_init__(self) -> None:
        self.closed: list[FileSummary] = []
        self._due: dict[str, Message] = {}
        self.latched, self.topics = dict(self.latched), dict(self.topics)  # they grow
        self.folder.mkdir(parents=True)
        try:
            self._begin_file(0)
            self._write_metadata(self.file.summary)
        except OSError:
            shutil.rmtree(self.folder, ignore_errors=True)
            raise

    @property
    def size(self) -> int:
        """Return the bytes on disk."""
        return sum(file.size for file in self.closed) + self.file.summary.size

    def count(self, topic: str) -> int:
        """Return the number of messages that were added to a topic."""
        counts = [self.file.counts, *(file.counts for file in self.closed)]
        return sum(count.get(topic, 0) for count in counts)

    def describe(self, topic: TopicChannel) -> None:
        """Add a topic; its messages may follow."""
        self.topics[topic.name] = topic
        if topic.name not in self.file.counts:
            self.file.describe(topic)

    def add(self, messages: Sequence[Message]) -> None:
        """Add messages of described topics."""
        self._repeat()
        self.file.add(messages)
        if latched := {name for name, topic in self.topics.items() if topic.latched}:
            self.latched |= {message[1]: message for message in messages if message[1] in latched}

    def repeat(self, latched: Mapping[str, Message]) -> None:
        """Add latched messages of described topics that came before log time was known."""
        self.latched |= latched
        self._due |= latched

    def commit(self) -> None:
        """Write all added messages to disk, and begin a new file if the present one is full.

        Raises OSError: something could not be written; no message is lost, commit again.
        """
        self._commit_file()
        full = self.max_size and self.file.summary.size >= self.max_size
        seconds = time.monotonic() - self._opened
        if full or (self.max_duration and seconds >= self.max_duration):
            self.split()

    def split(self) -> None:
        """Close the present file and begin the next, with latched messages repeated.

        Raises OSError: a file cannot be made or written; the present one goes on.
        """
        self._commit_file()
        full = self.file
        self._begin_file(len(self.closed) + 1)
        full.close()
        self.closed.append(full.summary)
        self._write_metadata(self.file.summary)

    def close(self) -> ClosedBag:
        """Write the remaining messages and close.

        Raises OSError: it cannot be written; the bag stays open, so that it can be tried again.
        """
        self._commit_file()
        return self.abandon()

    def abandon(self) -> ClosedBag:
        """Close without the messages that could not be written; the files stay readable."""
        self.file.close()
        return ClosedBag(self.folder, (*self.closed, self.file.summary), self.file.waiting)

    def _commit_file(self) -> None:
        self._repeat()
        before = self.file.summary
        try:
            self.file.commit(self._write_metadata)
        except OSError:
            with suppress(OSError):
                self._write_metadata(before)
            raise

    def _begin_file(self, number: int) -> None:
        file = GrowingMcap(self.folder / f"{self.folder.name}_{number}.mcap", self.storage)
        for topic in self.topics.values():
            file.describe(topic)
        self.file, self._opened, self._due = file, time.monotonic(), dict(self.latched)
        self._repeat()

    def _repeat(self) -> None:
        """Add the latched messages that are due in this file, once log time is known."""
        if self._due and (now := self.clock()):
            self.file.add((now, *message[1:]) for message in self._due.values())
            self._due = {}

    def _write_metadata(self, present: FileSummary) -> None:
        """Write metadata.yaml, version 9 (ROS 2 Jazzy), replacing the old one at once.

        Raises OSError: it cannot be written; the old one stays.
        """
        files = [*self.closed, present]
        start, duration = time_span(files)
        information = {
            "version": 9,
            "storage_identifier": "mcap",
            **_times(start, duration),
            "message_count": sum(file.messages for file in files),
            "topics_with_message_count": [
                {
                    "topic_metadata": {
                        "name": topic.name,
                        "type": topic.message_type,
                        "serialization_format": "cdr",
                        "offered_qos_profiles": [qos.document for qos in topic.offered],
                        "type_description_hash": topic.definition.hash,
                    },
                    "message_count": sum(file.counts.get(topic.name, 0) for file in files),
                }
                for topic in list(self.topics.values())
            ],
            "compression_format": "",
            "compression_mode": "",
            "relative_file_paths": [file.name for file in files],
            "files": [
                {
                    "path": file.name,
                    **_times(file.start or 0, file.duration),
                    "message_count": file.messages,
                }
                for file in files
            ],
            "custom_data": None,
            "ros_distro": "jazzy",
        }
        # JSON is YAML, and is written in no time: the file is renewed with every commit.
        text = json.dumps({"rosbag2_bagfile_information": information}, indent=2)
        write_together({self.folder / "metadata.yaml": text})


def _times(start: int, duration: int) -> dict[str, object]:
    return {
        "duration": {"nanoseconds": duration},
        "starting_time": {"nanoseconds_since_epoch": start},
    }


def time_span(files: Sequence[FileSummary]) -> tuple[int, int]:
    """Return first log time of all files, and from there to the last, ns; zero without messages."""
    starts = [file.start for file in files if file.start is not None]
    ends = [file.start + file.duration for file in files if file.start is not None]
    return (min(starts), max(ends) - min(starts)) if starts else (0, 0)
