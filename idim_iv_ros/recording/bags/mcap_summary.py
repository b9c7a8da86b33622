"""What the end of an MCAP file repeats of its beginning: topics, and how many messages each has."""

import struct
import zlib
from dataclasses import dataclass, field
from mmap import mmap

from idim_iv_ros.recording.bags.mcap_records import (
    CHANNEL,
    FOOTER,
    HEAD,
    SCHEMA,
    STATISTICS,
    records,
    text,
)

MAGIC = b"\x89MCAP0\r\n"
_FOOTER_SIZE = 20


@dataclass
class McapDescription:
    """Schemas and channels of a file, from its data or from its summary.

    Attributes
    ----------
    schemas : dict
        Name of each schema.
    channels : dict
        Topic of each channel of CDR messages.
    topics : dict
        Type of each topic.
    counts : dict or None
        Messages of each channel in the whole file; None where no summary says it.
    """

    schemas: dict[int, str] = field(default_factory=dict)
    channels: dict[int, str] = field(default_factory=dict)
    topics: dict[str, str] = field(default_factory=dict)
    counts: dict[int, int] | None = None

    def add(self, opcode: int, record: bytes) -> None:
        """Take a schema or channel record.

        Raises
        ------
        struct.error, UnicodeDecodeError
            It is damaged.
        """
        if opcode == SCHEMA:
            (number,) = struct.unpack_from("<H", record)
            self.schemas[number], _ = text(record, 2)
            return
        number, schema = struct.unpack_from("<HH", record)
        topic, place = text(record, 4)
        encoding, _ = text(record, place)
        if encoding == "cdr":
            self.channels[number] = topic
            self.topics[topic] = self.schemas.get(schema, "")


def read_summary(content: mmap) -> McapDescription | None:
    """Description at the end of a file, None where there is none or its checksum is wrong."""
    footer = len(content) - len(MAGIC) - _FOOTER_SIZE
    if footer < HEAD or content[-len(MAGIC) :] != MAGIC or content[footer - HEAD] != FOOTER:
        return None
    start, _, checksum = struct.unpack_from("<QQI", content, footer)
    if not len(MAGIC) <= start < footer - HEAD:
        return None
    # A writer that computes no checksum leaves it zero.
    if checksum not in (0, zlib.crc32(content[start : footer + 16])):
        return None
    description = McapDescription()
    try:
        for record in records(content, start):
            if record.opcode in (SCHEMA, CHANNEL):
                description.add(record.opcode, content[record.start : record.end])
            elif record.opcode == STATISTICS:
                description.counts = _counts(content[record.start : record.end])
            elif record.opcode == FOOTER:
                break
    except (struct.error, UnicodeDecodeError):
        return None
    return description


def _counts(record: bytes) -> dict[int, int]:
    """Messages of each channel, from a statistics record."""
    (size,) = struct.unpack_from("<I", record, 42)
    return dict(struct.iter_unpack("<HQ", record[46 : 46 + size]))
