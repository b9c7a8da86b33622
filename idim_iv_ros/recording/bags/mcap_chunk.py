"""Messages in the bytes of an MCAP chunk, thousands at once."""

import lz4.frame
import numpy as np
import zstandard
from numpy.typing import NDArray

from idim_iv_ros.recording.bags.mcap_records import HEAD, MESSAGE, MESSAGE_HEAD
from idim_iv_ros.recording.bags.message_batch import MessageBatch
from idim_iv_ros.types import IntArray


def start_of(payload: bytes, compression: str, size: int) -> bytes | None:
    """What can be decompressed of a chunk whose end is missing."""
    if compression == "zstd":
        return zstandard.ZstdDecompressor().decompressobj().decompress(payload)[:size]
    if compression == "lz4":
        return bytes(lz4.frame.LZ4FrameDecompressor().decompress(payload, size))
    return payload


def message_sizes(buffer: NDArray[np.uint8], channel: int, offsets: IntArray) -> IntArray | None:
    """Sizes of the messages that an index names; None if it names anything else."""
    if len(offsets) == 0:
        return np.zeros(0, dtype=np.int64)
    last = len(buffer) - HEAD - MESSAGE_HEAD
    if offsets.min() < 0 or offsets.max() > last or np.any(buffer[offsets] != MESSAGE):
        return None
    owner = buffer[offsets + HEAD] + 256 * buffer[offsets + HEAD + 1].astype(np.int64)
    sizes = integers(buffer, offsets + 1)
    whole = (sizes >= MESSAGE_HEAD) & (sizes <= len(buffer) - HEAD - offsets)
    return sizes if np.all(whole & (owner == channel)) else None


def stretches_between(
    whole: list[tuple[int, IntArray, IntArray]], length: int
) -> list[tuple[int, int]]:
    """Stretches of a chunk of so many bytes that belong to no message of an index."""
    if sum(int(sizes.sum()) + HEAD * len(sizes) for _, _, sizes in whole) == length:
        return []
    starts = np.concatenate([np.zeros(0, np.int64), *(offsets for _, offsets, _ in whole)])
    ends = np.concatenate([np.zeros(0, np.int64), *(o + HEAD + s for _, o, s in whole)])
    order = np.argsort(starts)
    begins = np.concatenate([[0], ends[order]])
    stops = np.concatenate([starts[order], [length]])
    return [(int(begins[k]), int(stops[k])) for k in np.flatnonzero(stops - begins >= HEAD)]


def message_batch(buffer: NDArray[np.uint8], offsets: IntArray, sizes: IntArray) -> MessageBatch:
    """Batch of the message records at `offsets` whose contents have `sizes` bytes."""
    return MessageBatch(
        buffer=buffer,
        offsets=offsets + HEAD + MESSAGE_HEAD,
        sizes=sizes - MESSAGE_HEAD,
        arrival=integers(buffer, offsets + HEAD + 6),
    )


def integers(buffer: NDArray[np.uint8], offsets: IntArray) -> IntArray:
    """Little-endian 64-bit integers at unaligned places."""
    raw = buffer[offsets[:, None] + np.arange(8)]
    return np.asarray(raw.view("<i8")[:, 0], dtype=np.int64)
