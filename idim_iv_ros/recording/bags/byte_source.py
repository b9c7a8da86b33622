"""Bytes that are not on this machine: what a reader asks of them."""

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from typing import IO, Protocol

# What is fetched at once: an object store takes some ten milliseconds to answer at all, in which it
# could have sent about this much.
READ_AHEAD = 1 << 20


class ByteSource(Protocol):
    """A file somewhere else; any part of it can be fetched.

    Attributes
    ----------
    size : int
        Bytes.
    """

    size: int

    def read(self, first: int, last: int) -> bytes:
        """Bytes `first` … `last`, the end excluded.

        Raises
        ------
        OSError
            They cannot be fetched.
        """
        ...


@contextmanager
def copied(source: ByteSource) -> Iterator[IO[bytes]]:
    """Return a temporary file with the whole content; it has no name that could be left behind."""
    with tempfile.TemporaryFile(prefix="idim_iv_") as file:
        for first in range(0, source.size, READ_AHEAD):
            file.write(source.read(first, min(first + READ_AHEAD, source.size)))
        file.flush()
        yield file
