"""One file of a bag, whatever its format, on this machine or somewhere else."""

import tempfile
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Protocol

import numpy as np
from numpy.typing import NDArray

from idim_iv_ros.recording.bags.joint_message_type import SchemaText

# What is fetched at once: an object store takes some ten milliseconds to answer at all, in which it
# could have sent about this much.
READ_AHEAD = 1 << 20


@dataclass(frozen=True)
class MessageBatch:
    """Serialised messages in one buffer."""

    buffer: NDArray[np.uint8]  # (n_bytes,)
    offsets: NDArray[np.int64]  # (k,), first byte of each message
    sizes: NDArray[np.int64]  # (k,), bytes
    arrival: NDArray[np.int64]  # (k,), log time, ns

    @classmethod
    def of(cls, messages: Sequence[tuple[int, bytes]]) -> "MessageBatch":
        """Return messages (log time in ns, bytes) as a batch."""
        sizes = np.array([len(data) for _, data in messages], dtype=np.int64)
        return cls(
            buffer=np.frombuffer(b"".join(data for _, data in messages), dtype=np.uint8),
            offsets=np.concatenate([[0], np.cumsum(sizes)[:-1]]),
            sizes=sizes,
            arrival=np.array([stamp for stamp, _ in messages], dtype=np.int64),
        )

    def __len__(self) -> int:
        return len(self.offsets)

    def message(self, number: int) -> bytes:
        """Return the bytes of one message."""
        start = int(self.offsets[number])
        return self.buffer[start : start + int(self.sizes[number])].tobytes()


class ByteSource(Protocol):
    """A file, perhaps on another machine, of which any part can be fetched."""

    size: int  # bytes

    def read(self, first: int, last: int) -> bytes:
        """Return the bytes `first` to `last`, the end excluded.

        Raises OSError: they cannot be fetched.
        """
        ...


class LocalFile:
    """A file on this machine as a `ByteSource`."""

    def __init__(self, path: Path) -> None:
        self.path, self.size = path, path.stat().st_size

    def read(self, first: int, last: int) -> bytes:
        """Return the bytes `first` to `last`, the end excluded."""
        with self.path.open("rb") as file:
            file.seek(first)
            return file.read(last - first)


@contextmanager
def opened(source: ByteSource) -> Iterator[IO[bytes]]:
    """Yield the file; of one that is elsewhere a copy without a name, which no crash leaves."""
    if isinstance(source, LocalFile):
        with source.path.open("rb") as file:
            yield file
        return
    with tempfile.TemporaryFile(prefix="idim_iv_") as file:
        for first in range(0, source.size, READ_AHEAD):
            file.write(source.read(first, min(first + READ_AHEAD, source.size)))
        file.seek(0)
        yield file


@dataclass
class BagFile(ABC):
    """One file of a bag; everything but its path is known as far as it was read."""

    path: Path  # the name of a remote file
    topics: dict[str, str] = field(default_factory=dict)  # type of each
    definitions: dict[str, SchemaText] = field(default_factory=dict)  # of each type
    truncated: bool = False  # whether the end is missing
    damaged: int = 0  # number of unreadable stretches and messages, which are left out
    missing: Counter[str] = field(default_factory=Counter)  # lost messages of each wanted topic
    counted: bool = True  # whether `missing` is complete

    @abstractmethod
    def batches(self, wanted: set[str]) -> Iterator[tuple[str, MessageBatch]]:
        """Yield topic and raw messages of the wanted topics, each batch in the order of arrival.

        Where no topic is wanted, no more is read than what tells all topics.

        Raises DataError: not a file of this format.
        """
