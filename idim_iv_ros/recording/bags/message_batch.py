"""Raw messages of one topic, as they lie in a chunk of a bag."""

from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray


@dataclass(frozen=True)
class MessageBatch:
    """Serialised messages in one buffer.

    Attributes
    ----------
    buffer : (n_bytes,) uint8
    offsets, sizes : (k,) int
        Where each message lies.
    arrival : (k,) int
        Log time, ns.
    """

    buffer: NDArray[np.uint8]
    offsets: NDArray[np.int64]
    sizes: NDArray[np.int64]
    arrival: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.offsets)

    def message(self, number: int) -> bytes:
        """Bytes of one message."""
        start = int(self.offsets[number])
        return self.buffer[start : start + int(self.sizes[number])].tobytes()

    def gather(self, numbers: NDArray[np.int64], size: int) -> NDArray[np.uint8]:
        """Messages `numbers`, all of `size` bytes, as rows (k, size)."""
        if len(numbers) == 0:
            return np.zeros((0, size), np.uint8)
        # Rows of a view are copied whole; an index for each byte takes eight times the memory.
        return np.asarray(sliding_window_view(self.buffer, size)[self.offsets[numbers]])
