"""The thread that empties the subscriptions: many messages at a time, no callback for each."""

import threading
from collections.abc import Callable, Sequence

from idim_iv_ros.errors import one_line
from idim_iv_ros.nodes.recorder.watched_topic import WatchedTopic
from idim_iv_ros.nodes.recorder.writer_thread import WriterThread

_PERIOD = 0.01  # s


class Intake(threading.Thread):
    """Takes what arrived on all topics a hundred times a second and hands it to the writer.

    It waits on a steady clock: with simulated time, or without any clock, messages are taken
    all the same.

    Parameters
    ----------
    writer : WriterThread
    largest : callable
        Bytes of the largest message that is taken.
    log_time : callable
        Time to log messages with, ns; None for their time of receipt.

    Attributes
    ----------
    topics : sequence of WatchedTopic
    failure : str
        Why messages could not be taken; empty if they could.
    """

    def __init__(
        self,
        writer: WriterThread,
        largest: Callable[[], int],
        log_time: Callable[[], int | None],
    ) -> None:
        super().__init__(name="intake", daemon=True)
        self.topics: Sequence[WatchedTopic] = ()
        self.failure = ""
        self._writer, self._largest, self._log_time = writer, largest, log_time
        self._lock = threading.Lock()
        self._ended = threading.Event()

    def run(self) -> None:
        """Take messages until `end`."""
        while not self._ended.wait(_PERIOD):
            try:
                self.drain()
            except Exception as error:  # one topic that cannot be read must not end all
                self.failure = f"cannot take messages: {one_line(error)}"

    def drain(self) -> None:
        """Hand over everything that has arrived by now."""
        with self._lock:
            for topic in self.topics:
                taken = topic.take(self._largest())
                if taken and topic.channel is not None:
                    self._writer.submit(topic.channel, topic.monitor, taken, self._log_time())

    def end(self) -> None:
        """End the thread."""
        self._ended.set()
        self.join()
