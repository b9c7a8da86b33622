"""Counting what happens on one topic: lost, late and malformed messages, gaps, stamps."""

import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from idim_iv_ros.nodes.recorder.joint_content import JointContent, header_stamps
from idim_iv_ros.types import IntArray

_UNKNOWN = 1 << 63  # sequence numbers from here on mean that the middleware does not count
_PERIODS = 200  # recent ones, whose median is the usual period


@dataclass(frozen=True)
class Received:
    """A batch of messages of one topic as the middleware handed it over.

    Attributes
    ----------
    topic : str
    messages : list of bytes
        Serialised.
    received, sent : (n,) int
        Times of receipt and source stamps, ns.
    sequence : (n,) int
        Publication sequence numbers, -1 where there are none.
    """

    topic: str
    messages: list[bytes]
    received: IntArray
    sent: IntArray
    sequence: IntArray


@dataclass(frozen=True)
class MonitorLimits:
    """What counts as late (s) and as a gap (in usual periods)."""

    late_after: float = 0.1
    gap_factor: float = 5.0


class TopicMonitor:
    """Counts of one topic since the last reset.

    Attributes
    ----------
    received, bytes : int
        Messages and their bytes.
    lost : int
        Holes in the publisher's sequence numbers; not counted while several publishers share
        the topic, for the middleware does not say which of them sent a message.
    late, gaps, longest_gap, backward : int, int, float (s), int
        `backward` counts stamps (of the header, the source or the receipt) that lie before the
        one before.
    """

    def __init__(self, content: JointContent | None, has_header: bool) -> None:
        self.content = content
        self._has_header = has_header
        self._periods: IntArray = np.zeros(0, dtype=np.int64)
        self._sequence: int | None = None
        self._last_sent: int | None = None
        self._last_received: int | None = None
        self._last_stamp: int | None = None
        self._arrived = time.monotonic()
        self.one_publisher = True
        self.reset()

    def reset(self) -> None:
        """Count from zero."""
        self.received = self.bytes = self.lost = self.late = self.gaps = self.backward = 0
        self.longest_gap = 0.0
        if self.content is not None:
            self.content.malformed = 0
            del self.content.joint_sets[:-1]

    def new_publishers(self, count: int) -> None:
        """Sequence numbers start anew."""
        self.one_publisher = count <= 1
        self._sequence = None

    @property
    def period(self) -> float | None:
        """Usual time between two messages, s; None before a few have come."""
        return float(np.median(self._periods)) * 1e-9 if len(self._periods) >= 10 else None

    @property
    def silence(self) -> float:
        """Seconds since the last message (or since the topic was first watched)."""
        return time.monotonic() - self._arrived

    def add(self, batch: Received, limits: MonitorLimits) -> None:
        """Count a batch."""
        if not batch.messages:
            return
        self._arrived = time.monotonic()
        self.received += len(batch.messages)
        self.bytes += sum(map(len, batch.messages))
        self._count_lost(batch.sequence)
        late = batch.received - batch.sent > limits.late_after * 1e9
        self.late += int(np.count_nonzero(late))
        self._count_gaps(batch.sent, limits.gap_factor)
        self._count_backward(batch)
        if self.content is not None:
            self.content.look(batch.messages)

    def _count_lost(self, sequence: IntArray) -> None:
        if sequence[0] < 0:
            return
        before = sequence[0] - 1 if self._sequence is None else self._sequence
        steps = np.diff(sequence, prepend=before)
        self._sequence = int(sequence[-1])
        if self.one_publisher:
            self.lost += int(np.sum(steps[steps > 1] - 1))

    def _count_gaps(self, sent: IntArray, factor: float) -> None:
        before = sent[0] if self._last_sent is None else self._last_sent
        steps = np.diff(sent, prepend=before)
        steps = steps[steps > 0]
        period = self.period
        if period is not None and len(steps):
            self.gaps += int(np.count_nonzero(steps > factor * period * 1e9))
        self.longest_gap = max(self.longest_gap, float(steps.max(initial=0)) * 1e-9)
        self._periods = np.append(self._periods, steps)[-_PERIODS:]

    def _count_backward(self, batch: Received) -> None:
        back = _falls(batch.sent, self._last_sent) | _falls(batch.received, self._last_received)
        self._last_sent, self._last_received = int(batch.sent[-1]), int(batch.received[-1])
        if self._has_header:
            stamps = header_stamps(batch.messages)
            back |= _falls(stamps, self._last_stamp)
            self._last_stamp = int(stamps[-1])
        self.backward += int(np.count_nonzero(back))


def batch_of(topic: str, taken: Sequence[tuple[bytes, dict[str, int | None]]]) -> Received:
    """Arrange what `take_message` returned."""
    count = len(taken)
    received = (info["received_timestamp"] or 0 for _, info in taken)
    sent = (info["source_timestamp"] or 0 for _, info in taken)
    sequence = (_number(info["publication_sequence_number"]) for _, info in taken)
    return Received(
        topic,
        [message for message, _ in taken],
        np.fromiter(received, np.int64, count),
        np.fromiter(sent, np.int64, count),
        np.fromiter(sequence, np.int64, count),
    )


def _number(sequence: int | None) -> int:
    return -1 if sequence is None or sequence >= _UNKNOWN else sequence


def _falls(times: IntArray, before: int | None) -> NDArray[np.bool_]:
    return np.asarray(np.diff(times, prepend=times[0] if before is None else before) < 0)
