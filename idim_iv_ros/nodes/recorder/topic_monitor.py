"""Monitor of one topic: lost, late and malformed messages, gaps, backward stamps, joint content."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from idim_iv_ros.errors import DataError
from idim_iv_ros.nodes.settings import RecorderSettings
from idim_iv_ros.recording.bags.bag_file import MessageBatch
from idim_iv_ros.recording.bags.joint_message_type import JointMessageType
from idim_iv_ros.recording.bags.joint_messages import JointMessageReader
from idim_iv_ros.types import IntArray

Taken = tuple[bytes, dict[str, int | None]]

_UNKNOWN = 1 << 63  # sequence numbers from here on mean that the middleware does not count
_PERIODS = 200  # recent ones, whose median is the usual period

# Latest messages of a batch, for a recorder of 10 kHz has no time for all; and those of the topic
# among which a joint is to be.
_LOOKED_AT = 50


class JointContent:
    """Checks the content of a topic with joint messages, of several parts of the robot or all.

    `joints` should be in them (empty: any), with numbers in the fields `needed`: ``position``,
    ``effort``. `malformed` counts messages that are not of the topic's type.
    """

    def __init__(self, message_type: str, joints: Sequence[str], needed: Sequence[str]) -> None:
        self.malformed = 0
        self._type, self._joints, self._needed = JointMessageType(message_type), joints, needed
        self._without = dict.fromkeys(joints, _LOOKED_AT)  # messages since it was named last
        self._names: tuple[str, ...] = ()
        self._missing: list[str] = []

    @property
    def problems(self) -> list[str]:
        """Return what the latest messages lack, in words."""
        absent = [joint for joint, count in self._without.items() if count >= _LOOKED_AT]
        lacks = [f"it does not hold joint {', '.join(absent)}"] if self._names and absent else []
        return [*lacks, *self._missing]

    def look(self, messages: Sequence[bytes]) -> None:
        """Check a batch of serialised messages, in the order of their arrival."""
        latest = [(0, message) for message in messages[-_LOOKED_AT:]]
        reader = JointMessageReader("", self._type, self._joints, self._needed)
        try:
            reader.add(MessageBatch.of(latest))
        except DataError as error:  # an array of another length
            self._missing = [str(error).removeprefix(": ")]
            return
        read = reader.finish()
        self.malformed += read.damaged
        self._names = read.names or self._names
        for column, joint in enumerate(self._joints):
            named = read.named[:, column].any()
            self._without[joint] = 0 if named else self._without[joint] + len(latest)
        if not len(read):  # all are of another part of the robot, or malformed
            return
        self._missing = []
        for field, values in read.values.items():
            wrong = read.named[read.layout[-1]] & ~np.isfinite(values[-1])
            bad = [joint for joint, is_wrong in zip(self._joints, wrong, strict=True) if is_wrong]
            if bad:
                self._missing.append(f"{field} of {', '.join(bad)} is NaN or missing")


@dataclass(frozen=True)
class Received:
    """A batch of messages of one topic as the middleware handed it over."""

    messages: list[bytes]
    received: IntArray  # (n,), ns
    sent: IntArray  # (n,), source stamps, ns
    sequence: IntArray  # (n,), publication sequence numbers, or -1


@dataclass(eq=False)
class TopicMonitor:
    """Counts of one topic since the last reset.

    `lost`: holes in the publisher's sequence numbers; not counted while several publishers share
    the topic, since the middleware does not say which of them sent a message. `backward`: messages
    whose stamp (of the header, the source or the receipt) precedes that of the previous message.
    """

    content: JointContent | None
    has_header: bool
    clock: Callable[[], float] = time.monotonic  # s

    def __post_init__(self) -> None:
        self._periods: IntArray = np.zeros(0, dtype=np.int64)
        self._sequence: int | None = None
        self._last: list[int] | None = None  # times of the last message
        self._arrived = self.clock()
        self.one_publisher = True
        self.reset()

    def reset(self) -> None:
        """Count from zero."""
        self.received = self.bytes = self.lost = self.late = self.gaps = self.backward = 0
        self.longest_gap = 0.0
        if self.content is not None:
            self.content.malformed = 0

    def new_publishers(self, count: int) -> None:
        """Restart the sequence numbers, for `count` publishers."""
        self.one_publisher = count <= 1
        self._sequence = None

    @property
    def counts_lost(self) -> bool:
        """Return whether `lost` is known: messages came from one publisher that numbers them."""
        return self.received > 0 and self.one_publisher and self._sequence is not None

    @property
    def period(self) -> float | None:
        """Return the median time between messages, s; None before ten have come."""
        return float(np.median(self._periods)) * 1e-9 if len(self._periods) >= 10 else None

    @property
    def silence(self) -> float:
        """Return the time since the last message (at first since construction), s."""
        return self.clock() - self._arrived

    def add(self, batch: Received, settings: RecorderSettings) -> None:
        """Count a batch; the settings define late messages and gaps."""
        if not batch.messages:
            return
        self._arrived = self.clock()
        self.received += len(batch.messages)
        self.bytes += sum(map(len, batch.messages))
        late = batch.received - batch.sent > settings.late_after * 1e9
        self.late += int(np.count_nonzero(late))
        if batch.sequence[0] >= 0:
            before = batch.sequence[0] - 1 if self._sequence is None else self._sequence
            steps = np.diff(batch.sequence, prepend=before)
            self._sequence = int(batch.sequence[-1])
            self.lost += int(np.sum(steps[steps > 1] - 1)) if self.one_publisher else 0
        stamps = [batch.sent, batch.received]
        stamps += [_header_stamps(batch.messages)] if self.has_header else []
        before = [times[0] for times in stamps] if self._last is None else self._last
        self._last = [int(times[-1]) for times in stamps]
        back = [np.diff(times, prepend=t) < 0 for times, t in zip(stamps, before, strict=True)]
        self.backward += int(np.count_nonzero(np.any(back, axis=0)))
        steps = np.diff(batch.sent, prepend=before[0])
        steps = steps[steps > 0]
        if self.period is not None:
            gap = settings.gap_factor * self.period * 1e9
            self.gaps += int(np.count_nonzero(steps > gap))
        self.longest_gap = max(self.longest_gap, float(steps.max(initial=0)) * 1e-9)
        self._periods = np.append(self._periods, steps)[-_PERIODS:]
        if self.content is not None:
            self.content.look(batch.messages)


def batch_of(taken: Sequence[Taken]) -> Received:
    """Arrange the messages of `take_message` with their times and numbers as arrays."""
    count = len(taken)
    received = (info["received_timestamp"] or 0 for _, info in taken)
    sent = (info["source_timestamp"] or 0 for _, info in taken)
    numbers = (info["publication_sequence_number"] for _, info in taken)
    sequence = (-1 if number is None or number >= _UNKNOWN else number for number in numbers)
    return Received(
        [message for message, _ in taken],
        np.fromiter(received, np.int64, count),
        np.fromiter(sent, np.int64, count),
        np.fromiter(sequence, np.int64, count),
    )


def _header_stamps(messages: Sequence[bytes]) -> IntArray:
    order = "<" if messages[0][1:2] == b"\x01" else ">"
    raw = b"".join([message[4:12].ljust(8, b"\0") for message in messages])
    stamps = np.frombuffer(raw, dtype=[("sec", order + "i4"), ("nanosec", order + "u4")])
    seconds = stamps["sec"].astype(np.int64)
    return np.asarray(seconds * 1_000_000_000 + stamps["nanosec"], dtype=np.int64)
