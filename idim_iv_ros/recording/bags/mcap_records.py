"""Walking the records of an MCAP file, past damaged ones. Format: https://mcap.dev/spec."""

import errno
import os
import re
import struct
from collections.abc import Iterator
from mmap import mmap
from typing import NamedTuple

DAMAGED = 0  # no opcode of the format: bytes that are no record
FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, INDEX, STATISTICS, DATA_END = 2, 3, 4, 5, 6, 7, 11, 15
CHUNK_INDEX = 8
HEAD = 9  # opcode and length
MESSAGE_HEAD = 22  # channel, sequence, log time, publish time
_LAST_OPCODE, _FIRST_PRIVATE = 15, 0x80

# A chunk by its compression, which is found 37 bytes behind its opcode; a message by its length.
_BEGINNINGS = re.compile(
    rb"\x06.{5}\0{3}.{28}(?:\x04\0{3}zstd|\x03\0{3}lz4|\0{4})|\x05.{2}\0{6}", re.DOTALL
)
_LONGEST_BEGINNING = 64  # bytes of the longest match, and some more
_IN_A_ROW = 3  # records that must follow each other where reading begins again
# Bytes that are no record: a file that holds so many more of them than of records is given up, for
# no recorder left it like that. Zeros, which a hole on the disk is made of, are passed by unread.
_MOST_GARBAGE, _BLOCK = 1 << 27, 1 << 20
_ZEROS = bytes(_BLOCK)

MAGIC = b"\x89MCAP0\r\n"
FOOTER_SIZE = 20


class Record(NamedTuple):
    """One record: what it is, and where its content lies; `end` may pass the end of the file."""

    opcode: int
    start: int
    end: int


def records(content: mmap | bytes, place: int, file: int | None = None) -> Iterator[Record]:
    """Records from `place` on.

    What is no record, because a byte of its head or of the one before is wrong, is given as
    ``DAMAGED``; reading goes on at the next record that can be recognised. The last one passes the
    end of a file that was cut. `file` is the descriptor of the file: its holes take no time then.
    """
    trusted, begin = place, place
    search = _Search(content, file)
    while place + HEAD <= len(content):
        record = _record(content, place)
        if record is not None and record.end <= len(content):
            yield record
            # The length of a chunk is written in it twice; any other may have led astray.
            trusted = record.end if record.opcode == CHUNK else record.start
            place = record.end
            continue
        following = search.next_beginning(trusted, most=_MOST_GARBAGE + place - begin)
        if following is None:
            if record is not None:
                yield record
            return
        yield Record(DAMAGED, place, following)
        trusted = place = following


def _record(content: mmap | bytes, place: int) -> Record | None:
    """Record at `place`, None where its head contradicts itself."""
    opcode, size = struct.unpack_from("<BQ", content, place)
    record = Record(opcode, place + HEAD, place + HEAD + size)
    if opcode == CHUNK:
        whole = _is_chunk(content, record)
    elif opcode == INDEX:
        whole = size >= 6 and (size - 6) % 16 == 0
    elif opcode == MESSAGE:
        whole = size >= MESSAGE_HEAD
    elif opcode == DATA_END:
        whole = size == 4
    elif opcode == FOOTER:
        whole = size == 20
    else:
        whole = 0 < opcode <= _LAST_OPCODE or opcode >= _FIRST_PRIVATE
    return record if whole else None


def _is_chunk(content: mmap | bytes, record: Record) -> bool:
    """Whether the length of a chunk is that of its parts."""
    if record.start + 40 > len(content):
        return False
    (name,) = struct.unpack_from("<I", content, record.start + 28)
    if name > 16 or record.start + 40 + name > len(content):
        return False
    (size,) = struct.unpack_from("<Q", content, record.start + 32 + name)
    return bool(record.end - record.start == 40 + name + size)


class _Search:
    """Looks for the next record behind bytes that are none."""

    def __init__(self, content: mmap | bytes, file: int | None) -> None:
        self._content, self._file = content, file
        self._garbage = 0

    def next_beginning(self, place: int, most: int) -> int | None:
        """Where the next record begins that others follow; None if none does.

        None too where more than `most` bytes in all are neither record nor zero.
        """
        content = self._content
        while place < len(content):
            place = self._behind_hole(place)
            if place >= len(content):
                break
            end = min(place + _BLOCK, len(content))
            block = content[place:end]
            if block != _ZEROS[: len(block)]:
                self._garbage += len(block)
                beginning = self._in_block(place, end)
                if beginning is not None:
                    self._garbage -= end - beginning
                    return beginning
                if self._garbage > most:
                    return None
            place = end
        return None

    def _in_block(self, place: int, end: int) -> int | None:
        beyond = min(end + _LONGEST_BEGINNING, len(self._content))
        for match in _BEGINNINGS.finditer(self._content, place, beyond):
            if match.start() >= end:
                return None
            if _leads_on(self._content, match.start()):
                return match.start()
        return None

    def _behind_hole(self, place: int) -> int:
        """The next place that lies on the disk: no record begins with a zero."""
        if self._file is None:
            return place
        try:
            return os.lseek(self._file, place, os.SEEK_DATA)
        except OSError as error:
            # Other errors come from file systems that do not know their holes.
            return len(self._content) if error.errno == errno.ENXIO else place


def _leads_on(content: mmap | bytes, place: int) -> bool:
    for _ in range(_IN_A_ROW):
        if place + HEAD > len(content):
            break
        record = _record(content, place)
        if record is None or record.end > len(content):
            return False
        if record.opcode == FOOTER:
            break
        place = record.end
    return True
