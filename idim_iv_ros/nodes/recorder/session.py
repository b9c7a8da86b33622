"""Recording as a state machine, and its two threads.

One takes messages from subscriptions and never waits for a disk, one counts and writes them.
"""

import shutil
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from enum import IntEnum
from itertools import repeat
from operator import itemgetter
from pathlib import Path
from queue import SimpleQueue
from typing import NamedTuple

import numpy as np

from idim_iv_ros.errors import UsageError, one_line
from idim_iv_ros.nodes.entry import Result, new_folder_path, promised
from idim_iv_ros.nodes.recorder.topic_monitor import Taken, TopicMonitor, batch_of
from idim_iv_ros.nodes.recorder.topics import TopicSet
from idim_iv_ros.nodes.settings import RecorderSettings
from idim_iv_ros.recording.writing.growing_bag import (
    ClosedBag,
    FileSummary,
    GrowingBag,
    Message,
)
from idim_iv_ros.recording.writing.write import PRESETS, TopicChannel

_OVERHEAD = 250  # bytes of memory for a message beside its content
_PERIOD, _INTAKE_PERIOD = 0.1, 0.01  # s


class State(IntEnum):
    """States of the recorder, numbered as in the message RecorderStatus."""

    IDLE = 0
    RECORDING = 1
    PAUSED = 2
    STOPPED_BY_FAULT = 3
    WAITING_FOR_CLOCK = 4


@dataclass
class SnapshotRing:
    """Messages of the last seconds, in memory. Not thread-safe."""

    duration: float  # s of log time for which messages are kept; 0: none
    limit: int  # bytes of memory
    size: int = 0  # bytes used, about

    def __post_init__(self) -> None:
        # Oldest and newest log time, memory, messages.
        self._batches: deque[tuple[int, int, int, Sequence[Message]]] = deque()
        self._channels: dict[str, TopicChannel] = {}

    def keep(self, duration: float, limit: int) -> None:
        """Change the duration, s, and the memory limit, bytes."""
        self.duration, self.limit = duration, limit
        if not duration:
            self._batches.clear()
            self.size = 0

    def add(self, channels: Sequence[TopicChannel], messages: Sequence[Message]) -> None:
        """Add messages of topics `channels`, in any order; drop those that are too old."""
        if not self.duration:
            return
        self._channels.update({channel.name: channel for channel in channels})
        times = [message[0] for message in messages]
        newest = max(times)
        size = sum(len(message[2]) for message in messages) + _OVERHEAD * len(messages)
        self._batches.append((min(times), newest, size, messages))
        self.size += size
        oldest = newest - round(self.duration * 1e9)
        while self._batches and (self.size > self.limit or self._batches[0][1] < oldest):
            self.size -= self._batches.popleft()[2]

    @property
    def span(self) -> float:
        """Return the time that the messages cover, s."""
        batches = self._batches
        return (batches[-1][1] - batches[0][0]) * 1e-9 if batches else 0.0

    def content(self) -> tuple[list[TopicChannel], list[Message]]:
        """Return the topics and messages, in the order of log time."""
        messages = [message for *_, batch in list(self._batches) for message in batch]
        messages.sort(key=itemgetter(0))
        present = {message[1] for message in messages}
        return [self._channels[name] for name in self._channels if name in present], messages


@dataclass
class RecordingSession:
    """State machine of the recorder, with one open bag at most. Not thread-safe."""

    settings: RecorderSettings
    clock: Callable[[], int]  # log time, ns; nothing is recorded while it is zero
    closed: Callable[[ClosedBag, bool], None]  # takes a bag, and whether it is not complete
    state: State = State.IDLE
    fault: str = ""  # one line on what is wrong and what to do
    dropped: int = 0  # messages that were not written since the start
    bag: GrowingBag | None = None

    def __post_init__(self) -> None:
        self.ring = SnapshotRing(self.settings.snapshot_duration, self.settings.snapshot_memory)
        self._latched: dict[str, tuple[TopicChannel, Message]] = {}
        self._last: tuple[FileSummary, ...] = ()
        self._started = self._committed = 0.0

    @property
    def waits(self) -> bool:
        """Return whether nothing can be recorded yet, because simulated time has not begun."""
        return self.clock() == 0

    @property
    def duration(self) -> float:
        """Return the seconds since the recording was started; zero when there is none."""
        return time.monotonic() - self._started if self.bag is not None else 0.0

    def recorded(self, topic: str) -> int:
        """Return the number of messages of a topic in the open bag, or in the last one."""
        if self.bag is not None:
            return self.bag.count(topic)
        return sum(file.counts.get(topic, 0) for file in self._last)

    def free_disk(self) -> int:
        """Return the free bytes on the disk of the bags; zero if unknown."""
        try:
            return shutil.disk_usage(self.settings.bag_directory).free
        except OSError:
            return 0

    def start(self) -> Path:
        """Open a new bag and return its folder; a UsageError says why that is impossible."""
        if self.bag is not None:
            raise UsageError(f"already recording into {self.bag.folder}; call stop first")
        settings = self.settings
        latched = {name: message for name, (_, message) in self._latched.items()}
        channels = {name: channel for name, (channel, _) in self._latched.items()}
        folder = Path(self.settings.bag_directory).resolve()
        try:
            folder.mkdir(parents=True, exist_ok=True)
            self._require_space()
            while self.bag is None:
                folder = self._new_folder()
                # Another recorder may begin in the same second, and be faster.
                with suppress(FileExistsError):
                    self.bag = GrowingBag(
                        folder,
                        self.clock,
                        latched,
                        channels,
                        storage=PRESETS[settings.storage_preset],
                        max_size=settings.max_file_size,
                        max_duration=settings.max_file_duration,
                    )
        except OSError as error:
            raise UsageError(f"{folder}: cannot be made: {error.strerror or error}") from error
        self.state, self.fault, self.dropped = State.RECORDING, "", 0
        self._started = self._committed = time.monotonic()
        return self.bag.folder

    def stop(self, *, aborted: bool = False) -> ClosedBag:
        """Close and return the bag; if `aborted`, its folder is renamed to ``…_aborted``."""
        bag = self._open_bag()
        try:
            closed = bag.close()
        except OSError as error:
            closed = bag.abandon()
            self.dropped += closed.lost
            self.fault = (
                f"{bag.folder}: {error.strerror or error}: closed without the last "
                f"{closed.lost} messages; free space before the next recording"
            )
        if aborted:  # so that nobody takes it for a whole one
            with suppress(OSError):  # it is announced as not complete all the same
                closed = replace(closed, folder=bag.folder.rename(f"{bag.folder}_aborted"))
        self._end(closed, faulty=bool(closed.lost), aborted=aborted)
        return closed

    def forget(self) -> None:
        """Drop the latched messages, for another robot follows."""
        self._latched.clear()

    def go_on(self, state: State) -> str:
        """Switch between RECORDING and PAUSED, and return the state in words."""
        self._open_bag()
        self.state = state
        return state.name.lower()

    def split(self) -> Path:
        """Go on in a new file and return the path of the old one; a UsageError says why not."""
        bag = self._open_bag()
        path = bag.file.path
        try:
            bag.split()
        except OSError as error:
            raise UsageError(f"{bag.folder}: {error.strerror or error}; not split") from error
        return path

    def write(self, channels: list[TopicChannel], messages: list[Message]) -> None:
        """Add messages of the topics `channels`, in any order, to the bag and the ring."""
        for channel in channels:
            if channel.latched:
                last = next(message for message in reversed(messages) if message[1] == channel.name)
                self._latched[channel.name] = (channel, last)
        untimed = {message[1]: message for message in messages if not message[0]}
        if untimed:
            messages = [message for message in messages if message[0]]
        if messages:
            self.ring.add(channels, messages)
        if self.state == State.STOPPED_BY_FAULT:
            self.dropped += len(messages)
        if self.bag is None or self.state != State.RECORDING:
            return
        for channel in channels:
            if self.bag.topics.get(channel.name) != channel:
                self.bag.describe(channel)
        latched = {channel.name for channel in channels if channel.latched}
        self.bag.repeat({name: untimed[name] for name in latched & untimed.keys()})
        self.bag.add(sorted(messages, key=itemgetter(0)))
        if self.bag.file.waiting_bytes > self.settings.memory_limit:
            closed = self.bag.abandon()
            self.dropped += closed.lost
            self._end(closed, faulty=True)
            self.fault = (
                f"{closed.folder}: {closed.lost} messages could not be written and memory_limit is "
                "reached; what is on disk is complete; free space, then call start"
            )

    def snapshot(self) -> tuple[Path, Callable[[], ClosedBag]]:
        """Return the folder of a new snapshot and what writes it; a UsageError says why not."""
        if not self.ring.duration:
            raise UsageError("no snapshot: snapshot_duration is 0; set it to the seconds to keep")
        channels, messages = self.ring.content()
        if not messages:
            raise UsageError("no snapshot: no message has arrived")
        self._require_space()
        topics = {name: channel for name, (channel, _) in self._latched.items()}
        topics |= {channel.name: channel for channel in channels}
        present = {message[1] for message in messages}
        before = {name: last for name, (_, last) in self._latched.items() if name not in present}
        folder, storage = self._new_folder("_snapshot"), PRESETS[self.settings.storage_preset]

        def write() -> ClosedBag:
            first = messages[0][0]
            bag = GrowingBag(folder, lambda: first, before, topics, storage)
            try:
                bag.add(messages)
                return bag.close()
            except OSError:
                bag.abandon()
                raise

        return folder, write

    def _new_folder(self, suffix: str = "") -> Path:
        directory = Path(self.settings.bag_directory).resolve()
        return new_folder_path(directory, self.settings.bag_prefix + suffix)

    def tick(self) -> None:
        """Write waiting messages to disk when due; call several times a second."""
        now = time.monotonic()
        if self.bag is None or now - self._committed < self.settings.chunk_duration:
            return
        self._committed = now
        try:
            self.bag.commit()
        except OSError as error:
            self.fault = (
                f"{self.bag.folder}: {error.strerror or error}: messages wait in memory; "
                "free space or call stop"
            )
            return
        self.fault = ""
        free = self.free_disk()
        if free < self.settings.minimum_free_disk:
            folder = self.bag.folder
            self._end(self.bag.close(), faulty=True)
            self.fault = (
                f"{folder}: stopped with {free / 1e6:.0f} MB of free disk left "
                f"(minimum_free_disk is {self.settings.minimum_free_disk / 1e6:.0f} MB); "
                "what arrived is in the bag; free space, then call start"
            )

    def _end(self, closed: ClosedBag, faulty: bool, aborted: bool = False) -> None:
        self._last = closed.files
        self.bag = None
        self.state = State.STOPPED_BY_FAULT if faulty else State.IDLE
        self.closed(closed, faulty or aborted)

    def _open_bag(self) -> GrowingBag:
        if self.bag is None:
            raise UsageError("nothing is being recorded; call start first")
        return self.bag

    def _require_space(self) -> None:
        free = self.free_disk()
        if free < self.settings.minimum_free_disk:
            raise UsageError(
                f"{self.settings.bag_directory}: {free / 1e6:.0f} MB of free disk, "
                f"minimum_free_disk is {self.settings.minimum_free_disk / 1e6:.0f} MB"
            )


class WriterThread(threading.Thread):
    """The only thread that uses a RecordingSession: counts messages and writes them."""

    def __init__(self, session: RecordingSession) -> None:
        super().__init__(name="writer", daemon=True)
        self.session = session
        self.overrun = 0  # messages dropped because `memory_limit` was full of unprocessed ones
        self.failure = ""  # an unexpected error, in words
        self._queue: SimpleQueue[_Batch | Callable[[], None]] = SimpleQueue()
        self._queued_bytes = 0
        self._wake = threading.Event()
        self._ended = False

    def submit(
        self, channel: TopicChannel, monitor: TopicMonitor, taken: list[Taken], log_time: int | None
    ) -> None:
        """Queue messages of one topic; `log_time`, ns, or None for their times of receipt."""
        size = sum(len(message) for message, _ in taken)
        if self._queued_bytes + size > self.session.settings.memory_limit:
            self.overrun += len(taken)
            return
        self._queued_bytes += size
        self._queue.put(_Batch(channel, monitor, taken, log_time, size))

    def call(self, function: Callable[[], Result], timeout: float = 10.0) -> Result:
        """Run a function in this thread after all queued messages, and return its result."""
        future, work = promised(function)
        self._queue.put(work)
        self._wake.set()
        return future.result(timeout)

    def end(self) -> None:
        """End the thread after all queued messages, and wait for it."""
        self._ended = True
        self._wake.set()
        self.join()

    def run(self) -> None:
        """Write messages until `end`."""
        while not self._ended:
            self._wake.wait(_PERIOD)
            self._wake.clear()
            self._guard(self._work)
            self._guard(self.session.tick)
        self._guard(self._work)

    def _guard(self, step: Callable[[], None]) -> None:
        try:
            step()
        except Exception as error:  # the thread must live on: what comes next can be written
            self.failure = f"messages could not be written: {one_line(error)}"

    def _work(self) -> None:
        """Process the queue: messages of each topic together, functions in between."""
        waiting: dict[str, list[_Batch]] = {}
        while not self._queue.empty():
            item = self._queue.get()
            if isinstance(item, _Batch):
                waiting.setdefault(item.channel.name, []).append(item)
                self._queued_bytes -= item.size
                continue
            self._write(waiting)
            waiting = {}
            item()
        self._write(waiting)

    def _write(self, waiting: "dict[str, list[_Batch]]") -> None:
        messages: list[Message] = []
        for topic, batches in waiting.items():
            taken = [message for batch in batches for message in batch.taken]
            arrived = batch_of(taken)
            batches[-1].monitor.add(arrived, self.session.settings)
            log_times = arrived.received.tolist()
            if batches[0].log_time is not None:
                log_times = [batch.log_time for batch in batches for _ in batch.taken]
            sequence = np.maximum(arrived.sequence, 0).tolist()
            columns = log_times, repeat(topic), arrived.messages, arrived.sent.tolist(), sequence
            messages += zip(*columns, strict=False)
        if messages:
            self.session.write([batches[-1].channel for batches in waiting.values()], messages)


class _Batch(NamedTuple):
    """Messages of one topic that wait to be counted and written; `size` in bytes."""

    channel: TopicChannel
    monitor: TopicMonitor
    taken: list[Taken]
    log_time: int | None
    size: int


class Intake(threading.Thread):
    """Thread that takes messages of all topics a hundred times a second for the writer.

    Its clock is steady. `log_time` returns the log time, ns, or None for the time of receipt.
    """

    def __init__(
        self, writer: WriterThread, topics: TopicSet, log_time: Callable[[], int | None]
    ) -> None:
        super().__init__(name="intake", daemon=True)
        self.failure = ""  # why messages could not be taken
        self._writer, self._topics, self._log_time = writer, topics, log_time
        self._lock = threading.Lock()
        self._ended = threading.Event()

    def run(self) -> None:
        """Take messages until `end`."""
        while not self._ended.wait(_INTAKE_PERIOD):
            try:
                self.drain()
            except Exception as error:  # one topic that cannot be read must not end all
                self.failure = f"cannot take messages: {one_line(error)}"

    def drain(self) -> None:
        """Hand all messages that have arrived to the writer."""
        with self._lock:
            for topic in self._topics.topics:
                taken = topic.take(self._writer.session.settings.max_message_size)
                if taken and topic.channel is not None:
                    self._writer.submit(topic.channel, topic.monitor, taken, self._log_time())

    def end(self) -> None:
        """End the thread."""
        self._ended.set()
        self.join()
