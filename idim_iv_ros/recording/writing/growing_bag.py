"""A rosbag2 folder while it is recorded: files that follow each other, metadata as it goes."""

import json
import shutil
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from idim_iv_ros.files import write_together
from idim_iv_ros.recording.writing.growing_mcap import FileSummary, GrowingMcap, Message
from idim_iv_ros.recording.writing.write import Storage, TopicChannel


@dataclass(frozen=True)
class SplitLimits:
    """When a new file begins; zero means never. Looked at once a commit.

    `size`: bytes of a file. `duration`: seconds for which a file was written.
    """

    size: int = 0
    duration: float = 0.0


@dataclass(frozen=True)
class ClosedBag:
    """A bag that is complete on disk; `lost` messages of it never got there."""

    folder: Path
    files: tuple[FileSummary, ...]
    lost: int = 0

    @property
    def duration(self) -> int:
        """From the first to the last message, ns."""
        return time_span(self.files)[1]


class GrowingBag:
    """One bag while it is recorded.

    What a commit adds is counted in metadata.yaml just before it is in the file: at no instant does
    the file hold more than a reader expects, and what a crash between the two loses can be counted.

    `folder`: made here; must not exist. `clock`: log time now, ns: what messages that are repeated
    at the start of a file are stamped with. Zero while it is not known; they are repeated as soon
    as it is. `latched`: last message of latched topics that arrived before the bag was opened.
    `topics`: known from the start. `storage`: compression and size of the chunks.
    Raises OSError: the folder or its first file cannot be made.
    """

    def __init__(
        self,
        folder: Path,
        limits: SplitLimits,
        clock: Callable[[], int] = time.time_ns,
        latched: Mapping[str, Message] | None = None,
        topics: Sequence[TopicChannel] = (),
        *,
        storage: Storage | None = None,
    ) -> None:
        self.folder = folder
        self.limits = limits
        self.closed: list[FileSummary] = []
        self.topics: dict[str, TopicChannel] = {topic.name: topic for topic in topics}
        self._clock = clock
        self._storage = storage
        self._latched: dict[str, Message] = dict(latched or {})
        self._due: dict[str, Message] = {}
        folder.mkdir(parents=True)
        try:
            self._begin_file(0)
            self._write_metadata(self.file.summary)
        except OSError:
            shutil.rmtree(folder, ignore_errors=True)
            raise

    @property
    def size(self) -> int:
        """Bytes on disk."""
        return sum(file.size for file in self.closed) + self.file.summary.size

    def count(self, topic: str) -> int:
        """Messages of a topic that were added."""
        closed = sum(file.counts.get(topic, 0) for file in self.closed)
        return closed + self.file.counts.get(topic, 0)

    def describe(self, topic: TopicChannel) -> None:
        """Make a topic known; its messages may follow."""
        self.topics[topic.name] = topic
        if not self.file.knows(topic.name):
            self.file.describe(topic)

    def add(self, messages: Sequence[Message]) -> None:
        """Take messages of described topics."""
        self._repeat()
        self.file.add(messages)
        latched = {name for name, topic in self.topics.items() if topic.latched}
        if latched:
            for message in messages:
                if message[1] in latched:
                    self._latched[message[1]] = message

    def repeat(self, latched: Mapping[str, Message]) -> None:
        """Take latched messages of described topics that came before log time was known."""
        self._latched |= latched
        self._due |= latched

    def commit(self) -> None:
        """Put everything on disk, and begin a new file if the present one is full.

        Raises OSError: something could not be written; nothing that was added is lost, commit
        again.
        """
        self._commit_file()
        size, duration = self.limits.size, self.limits.duration
        full = size and self.file.summary.size >= size
        if full or (duration and time.monotonic() - self._opened >= duration):
            self.split()

    def split(self) -> None:
        """Close the present file and begin the next; latched messages are repeated in it.

        Raises OSError: the next file cannot be made or the present one not be written; it goes on.
        """
        self._commit_file()
        full = self.file
        self._begin_file(len(self.closed) + 1)
        full.close()
        self.closed.append(full.summary)
        self._write_metadata(self.file.summary)

    def close(self) -> ClosedBag:
        """Write what is left and close.

        Raises OSError: it cannot be written; the bag stays open, so that it can be tried again.
        """
        self._commit_file()
        self.file.close()
        return ClosedBag(self.folder, (*self.closed, self.file.summary))

    def abandon(self) -> ClosedBag:
        """Close without what could not be written; the files are whole all the same."""
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
        file = GrowingMcap(self.folder / f"{self.folder.name}_{number}.mcap", self._storage)
        for topic in self.topics.values():
            file.describe(topic)
        self.file, self._opened, self._due = file, time.monotonic(), dict(self._latched)
        self._repeat()

    def _repeat(self) -> None:
        """Add the latched messages that are due in this file, once log time is known."""
        if self._due and (now := self._clock()):
            self.file.add((now, *message[1:]) for message in self._due.values())
            self._due = {}

    def _write_metadata(self, present: FileSummary) -> None:
        write_metadata(self.folder, [*self.closed, present], list(self.topics.values()))


def write_metadata(
    folder: Path, files: Sequence[FileSummary], topics: Sequence[TopicChannel]
) -> None:
    """Write metadata.yaml, version 9 (ROS 2 Jazzy): a reader sees the old one or the new one.

    Raises OSError: it cannot be written; the old one stays.
    """
    document = {"rosbag2_bagfile_information": _metadata(files, topics)}
    # JSON is YAML, and is written in no time: the file is renewed with every commit.
    write_together({folder / "metadata.yaml": json.dumps(document, indent=2)})


def _metadata(files: Sequence[FileSummary], topics: Sequence[TopicChannel]) -> dict[str, object]:
    start, duration = time_span(files)
    return {
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
                    "type_description_hash": topic.type_hash,
                },
                "message_count": sum(file.counts.get(topic.name, 0) for file in files),
            }
            for topic in topics
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


def _times(start: int, duration: int) -> dict[str, object]:
    return {
        "duration": {"nanoseconds": duration},
        "starting_time": {"nanoseconds_since_epoch": start},
    }


def time_span(files: Sequence[FileSummary]) -> tuple[int, int]:
    """First log time of all files, and from there to the last, ns; zero without messages."""
    starts = [file.start for file in files if file.start is not None]
    ends = [file.start + file.duration for file in files if file.start is not None]
    return (min(starts), max(ends) - min(starts)) if starts else (0, 0)
