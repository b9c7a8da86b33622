"""Long bags in segments: hours at a kilohertz are read once, and never held whole."""

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from idim_iv_ros.errors import DataError
from idim_iv_ros.recording.bags.cdr import MessageBatch
from idim_iv_ros.recording.bags.folder import Bag, with_loss
from idim_iv_ros.recording.bags.joint_messages import JointMessageReader
from idim_iv_ros.recording.other_topics import robot_description
from idim_iv_ros.recording.read import recording_of
from idim_iv_ros.recording.recording import Recording
from idim_iv_ros.recording.request import Request, add_batch, in_bag
from idim_iv_ros.types import BoolArray

# s; at 1 kHz and seven joints an identification of so much takes less than a gigabyte. Filters
# lose about a tenth of a second at each edge.
SEGMENT = 300.0
# A topic that is this far behind the others, in segments, has ended: nobody waits for it.
_BEHIND = 2


def read_segments(
    bag: Bag, request: Request, seconds: float = SEGMENT
) -> Iterator[Recording | DataError]:
    """Read a bag segment by segment; one of up to one and a half segments is read as a whole.

    Segments end at the same arrival time in all topics. The last one takes what remains, from half
    a segment to one and a half. One that does not hold what is asked for is given as its error:
    others may.

    Raises
    ------
    UsageError
        No such bag.
    DataError
        The bag cannot be read.
    OSError
        Its files cannot be read.
    """
    request = in_bag(bag, request)
    parts = _Parts(bag, request, round(1e9 * seconds))
    likely = request.descriptions
    for topic, batch in bag.batches({*request.topics, *likely}):
        if topic in likely:
            parts.describe(topic, batch)
        elif len(batch):
            yield from parts.add(topic, batch)
    yield from parts.rest()


@dataclass
class _Parts:
    """Messages of the running segment, and those that arrived after its end."""

    bag: Bag
    request: Request
    length: int  # ns
    descriptions: dict[str, str] = field(default_factory=dict)
    end: int | None = None
    later: list[tuple[str, MessageBatch]] = field(default_factory=list)
    latest: dict[str, int] = field(default_factory=dict)
    readers: dict[str, JointMessageReader] = field(default_factory=dict)

    def describe(self, topic: str, batch: MessageBatch) -> None:
        """Take a description of the robot."""
        text = robot_description(batch)
        self.descriptions.update({} if text is None else {topic: text})

    def add(self, topic: str, batch: MessageBatch) -> Iterator[Recording | DataError]:
        """Take a batch; a segment comes out when another half has arrived behind its end."""
        while self._passed(topic):
            yield self._close()
        self._take(topic, batch)

    def rest(self) -> Iterator[Recording | DataError]:
        """Give everything that was not given yet."""
        while self.end is not None and max(self.latest.values()) >= self.end + self.length // 2:
            yield self._close()
        for topic, batch in self.later:
            self._read(topic, batch)
        yield self._finish()

    def _passed(self, topic: str) -> bool:
        """Whether all topics are half a segment behind the end, as far as they go on.

        Topics of a chunk come one after the other. When one comes again, the chunk before is done:
        a topic that was not in it for two segments has ended.
        """
        if self.end is None:
            return False
        slowest = min(self.latest.get(name, 0) for name in self.request.topics)
        if slowest >= self.end + self.length // 2:
            return True
        return self.latest.get(topic, 0) >= self.end + _BEHIND * self.length

    def _take(self, topic: str, batch: MessageBatch) -> None:
        if self.end is None:
            self.end = int(batch.arrival.min()) + self.length
        inside = batch.arrival < self.end
        self._read(topic, batch if inside.all() else _part(batch, inside))
        if not inside.all():
            self.later.append((topic, _part(batch, ~inside)))
        self.latest[topic] = max(self.latest.get(topic, 0), int(batch.arrival.max()))

    def _close(self) -> Recording | DataError:
        """Finish the segment, and begin the next one with what arrived after its end."""
        finished = self._finish()
        assert self.end is not None
        self.end += self.length
        waiting, self.later = self.later, []
        for topic, batch in waiting:
            self._take(topic, batch)
        return finished

    def _read(self, topic: str, batch: MessageBatch) -> None:
        if len(batch):
            add_batch(self.readers, self.bag, self.request, topic, batch)

    def _finish(self) -> Recording | DataError:
        readers, self.readers = self.readers, {}
        try:
            description = self.request.likeliest(self.descriptions)
            return recording_of(self.bag, self.request, readers, description)
        except DataError as error:
            return with_loss(error, self.bag, self.request.topics)


def _part(batch: MessageBatch, chosen: BoolArray) -> MessageBatch:
    """Some messages in a buffer of their own: the chunk, with all its other topics, is let go."""
    numbers = np.flatnonzero(chosen)
    messages = [batch.message(int(number)) for number in numbers]
    sizes = batch.sizes[numbers]
    ends = np.cumsum(sizes)
    buffer = np.frombuffer(b"".join(messages), dtype=np.uint8)
    return MessageBatch(buffer, ends - sizes, sizes, batch.arrival[numbers])
