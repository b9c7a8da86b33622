"""How a recorded MCAP file is stored: compression, and the size of its chunks."""

from dataclasses import dataclass

from mcap.writer import CompressionType


@dataclass(frozen=True)
class Storage:
    """Compression of chunks, and the bytes from which on a chunk ends."""

    compression: CompressionType = CompressionType.ZSTD
    chunk_size: int = 1 << 20


# What rosbag2's presets of the same purpose choose (fastwrite, zstd_fast, zstd_small), as far as a
# file that survives a crash allows: chunks and their index are always written.
PRESETS = {
    "default": Storage(),
    "none": Storage(CompressionType.NONE),
    "fast": Storage(CompressionType.LZ4),
    "small": Storage(CompressionType.ZSTD, 4 << 20),
}
