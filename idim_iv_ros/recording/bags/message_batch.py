"""Serialised messages of one topic, thousands at once."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class MessageBatch:
    """Serialised messages in one buffer.

    `buffer` (n_bytes,) uint8. `offsets`, `sizes` (k,) int: where each message lies. `arrival` (k,)
    int: log time, ns.
    """

    buffer: NDArray[np.uint8]
    offsets: NDArray[np.int64]
    sizes: NDArray[np.int64]
    arrival: NDArray[np.int64]

    @classmethod
    def of(cls, messages: Sequence[tuple[int, bytes]]) -> "MessageBatch":
        """Put messages with their log times one behind the other."""
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
        """Bytes of one message."""
        start = int(self.offsets[number])
        return self.buffer[start : start + int(self.sizes[number])].tobytes()
