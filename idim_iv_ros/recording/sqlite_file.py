"""rosbag2's sqlite3 files, with or without their metadata.yaml."""

import sqlite3
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from urllib.parse import quote

import numpy as np

from idim_iv_ros.errors import DataError
from idim_iv_ros.recording.message_batch import MessageBatch

_ROWS = 20_000


@dataclass
class SqliteFile:
    """One .db3 file.

    Attributes
    ----------
    path : Path
    topics : dict
        Type of each topic, known once it was read.
    truncated : bool
        Whether reading stopped at a damaged page.
    damaged : int
        Always zero: a damaged page ends the file.
    """

    path: Path
    topics: dict[str, str] = field(default_factory=dict)
    truncated: bool = False
    damaged: int = 0

    def batches(self, wanted: set[str]) -> Iterator[tuple[str, MessageBatch]]:
        """Raw messages of the wanted topics in the order of their arrival.

        Raises
        ------
        DataError
            Not a rosbag2 database.
        """
        # A write-ahead log beside the file holds what a killed recorder had not merged yet.
        mode = "mode=ro" if Path(f"{self.path}-wal").exists() else "immutable=1"
        address = f"file:{quote(str(self.path))}?{mode}"
        try:
            with sqlite3.connect(address, uri=True) as connection:
                yield from self._read(connection, wanted)
        except sqlite3.DatabaseError as error:
            if not self.topics:
                raise DataError(f"{self.path}: not a rosbag2 database ({error})") from error
            self.truncated = True

    def _read(
        self, connection: sqlite3.Connection, wanted: set[str]
    ) -> Iterator[tuple[str, MessageBatch]]:
        query = "SELECT id, name, type, serialization_format FROM topics"
        numbers = {}
        for number, name, message_type, encoding in connection.execute(query):
            if encoding == "cdr":
                self.topics[str(name)] = str(message_type)
                numbers[number] = str(name)
        for number, topic in numbers.items():
            if topic not in wanted:
                continue
            rows = connection.execute(
                "SELECT timestamp, data FROM messages WHERE topic_id = ? ORDER BY timestamp, id",
                (number,),
            )
            while block := rows.fetchmany(_ROWS):
                sizes = np.array([len(data) for _, data in block], dtype=np.int64)
                yield (
                    topic,
                    MessageBatch(
                        buffer=np.frombuffer(b"".join(data for _, data in block), dtype=np.uint8),
                        offsets=np.concatenate([[0], np.cumsum(sizes)[:-1]]),
                        sizes=sizes,
                        arrival=np.array([stamp for stamp, _ in block], dtype=np.int64),
                    ),
                )
