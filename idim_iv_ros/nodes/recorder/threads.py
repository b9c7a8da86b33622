"""The recorder's two threads: one takes messages from subscriptions, one counts and writes them.

Taking messages never waits for a disk.
"""

import threading
from collections.abc import Callable
from itertools import repeat
from queue import Empty, SimpleQueue
from typing import NamedTuple

import numpy as np

from idim_iv_ros.errors import one_line
from idim_iv_ros.nodes.entry import Result, promised
from idim_iv_ros.nodes.recorder.session import RecordingSession
from idim_iv_ros.nodes.recorder.topic_monitor import Taken, TopicMonitor, batch_of
from idim_iv_ros.nodes.recorder.topics import TopicSet
from idim_iv_ros.recording.writing.growing_bag import Message
from idim_iv_ros.recording.writing.write import TopicChannel

_PERIOD, _INTAKE_PERIOD = 0.1, 0.01  # s


class WriterThread(threading.Thread):
    """The only thread that uses a RecordingSession: counts messages and writes them.

    `overrun` counts messages that were dropped because `memory_limit` was full of unprocessed
    messages; `failure` is an unexpected error, in words.
    """

    def __init__(self, session: RecordingSession) -> None:
        super().__init__(name="writer", daemon=True)
        self.session = session
        self.overrun = 0
        self.failure = ""
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
        while True:
            try:
                item = self._queue.get_nowait()
            except Empty:
                break
            if isinstance(item, _Batch):
                waiting.setdefault(item.channel.name, []).append(item)
                self._queued_bytes -= item.size
                continue
            self._write(waiting)
            waiting = {}
            item()
        self._write(waiting)

    def _write(self, waiting: "dict[str, list[_Batch]]") -> None:
        """Count waiting messages by topic, and hand them to the session."""
        messages: list[Message] = []
        for topic, batches in waiting.items():
            taken = [message for batch in batches for message in batch.taken]
            arrived = batch_of(taken)
            batches[-1].monitor.add(arrived, self.session.settings)
            log_times = arrived.received.tolist()
            if batches[0].log_time is not None:
                log_times = [batch.log_time for batch in batches for _ in batch.taken]
            sequence = np.maximum(arrived.sequence, 0).tolist()
            sent = arrived.sent.tolist()
            messages += zip(
                log_times, repeat(topic), arrived.messages, sent, sequence, strict=False
            )
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

    It waits on a steady clock, so that simulated time cannot stop it. `log_time` returns the log
    time, ns, or None for the time of receipt. `failure` says why messages could not be taken.
    """

    def __init__(
        self, writer: WriterThread, topics: TopicSet, log_time: Callable[[], int | None]
    ) -> None:
        super().__init__(name="intake", daemon=True)
        self.failure = ""
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
