"""MCAP files in short chunks: a damaged byte costs the messages of one chunk."""

from typing import IO, cast

from mcap.writer import CompressionType, Writer

_DURATION = 1_000_000_000  # ns
_SIZE = 1 << 20  # bytes


class ShortChunkWriter(Writer):
    """Writes chunks of at most one second of log time, and of little more than 1 MiB.

    Parameters
    ----------
    stream
        Has `write`, `tell` and `flush`.
    library
        What wrote the file, in its header.
    summary_offsets
        Whether they are written; they pile up where `finish` is called again and again.
    """

    def __init__(self, stream: object, *, library: str, summary_offsets: bool = True) -> None:
        super().__init__(
            cast(IO[bytes], stream),
            chunk_size=_SIZE,
            compression=CompressionType.ZSTD,
            use_summary_offsets=summary_offsets,
        )
        self._first: int | None = None
        self.start(profile="ros2", library=library)

    def add_message(
        self, channel_id: int, log_time: int, data: bytes, publish_time: int, sequence: int = 0
    ) -> None:
        """Write a message, in a new chunk if the present one is a second long."""
        if self._first is None:
            self._first = log_time
        elif abs(log_time - self._first) >= _DURATION:
            self.flush()
            self._first = log_time
        super().add_message(channel_id, log_time, data, publish_time, sequence)

    def flush(self) -> None:
        """End the present chunk."""
        self._first = None
        super().flush()  # type: ignore[no-untyped-call]
