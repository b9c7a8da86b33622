"""The last seconds of all topics in memory, written as a bag when somebody asks for it."""

from collections import deque
from collections.abc import Mapping, Sequence
from pathlib import Path

from idim_iv_ros.recording.writing.growing_bag import ClosedBag, GrowingBag, SplitLimits
from idim_iv_ros.recording.writing.growing_mcap import Message
from idim_iv_ros.recording.writing.write import Storage, TopicChannel

_OVERHEAD = 250  # bytes of memory for a message beside its content


class SnapshotRing:
    """Messages of the last seconds. Not for several threads.

    Parameters
    ----------
    duration : float
        s of log time; 0: nothing is kept.
    limit : int
        Bytes of memory; with more the oldest messages go earlier.

    Attributes
    ----------
    size : int
        Bytes of memory that are used, about.
    """

    def __init__(self, duration: float, limit: int) -> None:
        self.duration, self.limit = duration, limit
        self.size = 0
        # Oldest and newest log time, memory, messages.
        self._batches: deque[tuple[int, int, int, Sequence[Message]]] = deque()
        self._channels: dict[str, TopicChannel] = {}

    def add(self, channels: Sequence[TopicChannel], messages: Sequence[Message]) -> None:
        """Take messages, in any order, and forget those that are too old."""
        if not self.duration:
            return
        self._channels.update({channel.name: channel for channel in channels})
        times = [message[0] for message in messages]
        newest = max(times)
        size = sum(len(message[2]) for message in messages) + _OVERHEAD * len(messages)
        self._batches.append((min(times), newest, size, messages))
        self.size += size
        while self._batches and (
            self.size > self.limit or newest - self._batches[0][1] > self.duration * 1e9
        ):
            self.size -= self._batches.popleft()[2]

    @property
    def span(self) -> float:
        """Seconds that are kept."""
        batches = self._batches
        return (batches[-1][1] - batches[0][0]) * 1e-9 if batches else 0.0

    def content(self) -> tuple[list[TopicChannel], list[Message]]:
        """What is kept, in the order of its log time."""
        messages = [message for *_, batch in list(self._batches) for message in batch]
        messages.sort(key=lambda message: message[0])
        present = {message[1] for message in messages}
        return [self._channels[name] for name in self._channels if name in present], messages


def write_snapshot(
    folder: Path,
    content: tuple[Sequence[TopicChannel], Sequence[Message]],
    latched: Mapping[str, Message],
    latched_channels: Sequence[TopicChannel],
    storage: Storage,
) -> ClosedBag:
    """Write messages, and before them the last ones of latched topics, as one bag.

    Raises
    ------
    OSError
        It cannot be written.
    """
    channels, messages = content
    first = messages[0][0]
    present = {message[1] for message in messages}
    before = {name: message for name, message in latched.items() if name not in present}
    topics = {channel.name: channel for channel in (*latched_channels, *channels)}
    bag = GrowingBag(
        folder, SplitLimits(), lambda: first, before, list(topics.values()), storage=storage
    )
    try:
        bag.add(messages)
        return bag.close()
    except OSError:
        bag.abandon()
        raise
