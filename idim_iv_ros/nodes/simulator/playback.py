"""A thread that publishes serialised messages in real time, and rests between two motions."""

import struct
import threading
import time
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from idim_iv_ros.errors import one_line
from idim_iv_ros.recording import JointTopic
from idim_iv_ros.recording.writing.write import serialised

_STAMP = struct.Struct("<iI")
_PLACE = 4  # of the stamp in a message
_CATCH_UP = 0.5  # s that a thread that was held up makes good at most


class Playback(threading.Thread):
    """Publishes motions one after the other; the end of the last is repeated while none waits.

    Parameters
    ----------
    resting : sequence of JointTopic
        The robot before its first motion.
    publish : mapping
        For each topic the function that takes a serialised message.
    clock : callable
        Time now, ns.
    rest : float
        Seconds at the end of every motion in which the robot rests.

    Attributes
    ----------
    failure : str
        Why messages could not be published; empty if they could.
    """

    def __init__(
        self,
        resting: Sequence[JointTopic],
        publish: Mapping[str, Callable[[bytes], None]],
        clock: Callable[[], int],
        rest: float,
    ) -> None:
        super().__init__(name="playback", daemon=True)
        self._first = _Motion(resting)
        self.failure = ""
        self._publish, self._clock, self._rest = publish, clock, rest
        self._next: _Motion | None = None
        self._moving = False
        self._ended = threading.Event()

    @property
    def moving(self) -> bool:
        """Whether a motion is under way or waits."""
        return self._moving or self._next is not None

    def play(self, topics: Sequence[JointTopic]) -> None:
        """Play a motion after the present one or from rest."""
        self._next = _Motion(topics)

    def end(self) -> None:
        """End the thread."""
        self._ended.set()
        self.join()

    def run(self) -> None:
        """Publish until `end`."""
        motion, first, begin = self._first, 0, time.monotonic()
        while not self._ended.is_set():
            if self._next is not None:
                motion, self._next, first = self._next, None, 0
                self._moving = True
            else:
                first, self._moving = motion.at_rest(self._rest), False
            begin = max(self._pass(motion, first, begin), time.monotonic() - _CATCH_UP)

    def _pass(self, motion: "_Motion", first: int, begin: float) -> float:
        """Publish from sample `first` on; return when the next pass begins, s."""
        samples = motion.samples
        base = self._clock() - int((time.monotonic() - begin) * 1e9)
        for sample in range(first, samples):
            ahead = begin + motion.time[sample] - motion.time[first] - time.monotonic()
            if ahead > 0:
                time.sleep(ahead)
            if self._ended.is_set() or (not self._moving and self._next is not None):
                return time.monotonic()
            try:
                motion.publish(sample, first, base, self._publish)
            except Exception as error:  # the next message may pass
                self.failure = one_line(error)
        return begin + (samples - first) * motion.period


class _Motion:
    """Serialised messages of all topics."""

    def __init__(self, topics: Sequence[JointTopic]) -> None:
        self.samples = min(len(topic.time) for topic in topics)
        reference = topics[-1].time if len(topics) > 1 else topics[0].time
        self.period = float(np.mean(np.diff(reference)))
        self.time: list[float] = (np.arange(self.samples) * self.period).tolist()
        zero = np.zeros(self.samples, dtype=np.int64)
        self._messages = [(topic.name, serialised(topic, zero)) for topic in topics]
        self._stamps = [
            np.round(topic.time[: self.samples] * 1e9).astype(np.int64).tolist() for topic in topics
        ]

    def at_rest(self, seconds: float) -> int:
        """First sample of the last `seconds`, half of which the robot needs to settle."""
        return max(0, self.samples - round(0.5 * seconds / self.period))

    def publish(
        self,
        sample: int,
        first: int,
        base: int,
        publish: Mapping[str, Callable[[bytes], None]],
    ) -> None:
        """Publish one sample of every topic; `base` is the time of sample `first`, ns."""
        for (topic, messages), stamps in zip(self._messages, self._stamps, strict=True):
            stamp = base + stamps[sample] - stamps[first]
            message = bytearray(messages[sample].tobytes())
            _STAMP.pack_into(message, _PLACE, *divmod(stamp, 1_000_000_000))
            publish[topic](bytes(message))
