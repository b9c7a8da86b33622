"""rosbag2's sqlite3 files, with or without their metadata.yaml.

A file may hold any database: only tables are read, by their row numbers, and nothing in it that
computes (views, virtual tables, generated columns).
"""

import os
import sqlite3
from collections.abc import Iterator
from contextlib import closing, suppress
from itertools import islice
from urllib.parse import quote

from idim_iv_ros.errors import DataError
from idim_iv_ros.recording.bags.bag_file import BagFile, MessageBatch
from idim_iv_ros.recording.bags.joint_message_type import SchemaText, note_type

_TOPICS = 10_000
_LONGEST_ROW = 1 << 28  # bytes
_TOGETHER, _BYTES_TOGETHER = 20_000, 1 << 26  # messages of a batch, and their bytes
# After a damaged page reading goes on this many rows later, then twice as many, …
_FIRST_STEP, _MOST_HOLES = 1, 200
_COLUMNS = {
    "topics": {"id", "name", "type", "serialization_format"},
    "messages": {"topic_id", "timestamp", "data"},
}


class SqliteFile(BagFile):
    """One .db3 file; losses on damaged pages are uncounted, since their topic is unknown."""

    def batches(self, wanted: set[str]) -> Iterator[tuple[str, MessageBatch]]:
        """Yield topic and raw messages of the wanted topics, block by block; see `BagFile`."""
        mode = "immutable=1"
        with suppress(OSError):  # a name too long for a file
            # A write-ahead log holds what a killed recorder had not merged yet.
            if self.path.with_name(f"{self.path.name}-wal").is_file():
                mode = "mode=ro"
        address = f"file:{quote(os.fsencode(self.path))}?{mode}"
        try:
            with closing(sqlite3.connect(address, uri=True)) as connection:
                numbers = self._open(connection)
                topics = {number: name for number, name in numbers.items() if name in wanted}
                yield from _in_batches(self._messages(connection, topics))
                self.counted = not (self.truncated or self.damaged)
        except (sqlite3.Error, UnicodeDecodeError) as error:  # a damaged name is no text
            raise DataError(f"{self.path}: not a rosbag2 database ({error})") from error

    def _open(self, connection: sqlite3.Connection) -> dict[int, str]:
        """Return the topics by their number, of a database with the tables of rosbag2."""
        connection.text_factory = bytes
        connection.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, _LONGEST_ROW)
        connection.execute("PRAGMA query_only = 1")
        connection.execute("PRAGMA trusted_schema = 0")
        for table, needed in _COLUMNS.items():
            self._require_table(connection, table, needed)
        numbers: dict[int, str] = {}
        query = f"SELECT id, name, type, serialization_format FROM topics LIMIT {_TOPICS}"
        for number, name, message_type, encoding in connection.execute(query):
            if not (isinstance(name, bytes) and isinstance(message_type, bytes)):
                continue
            if isinstance(number, int) and encoding == b"cdr":
                numbers[number] = name.decode(errors="replace")
                note_type(self.topics, numbers[number], message_type.decode(errors="replace"))
        columns = ("topic_type", "encoding", "encoded_message_definition")
        try:
            self._require_table(connection, "message_definitions", set(columns))
        except DataError:  # of before Iron
            return numbers
        query = f"SELECT {', '.join(columns)} FROM message_definitions LIMIT {_TOPICS}"
        for row in connection.execute(query):
            if all(isinstance(cell, bytes) for cell in row):
                name, encoding, text = (part.decode(errors="replace") for part in row)
                self.definitions[name] = SchemaText(encoding, text)
        return numbers

    def _require_table(self, connection: sqlite3.Connection, table: str, needed: set[str]) -> None:
        """Refuse views, virtual tables and computed columns, whose queries may never end."""
        query = "SELECT type, sql FROM sqlite_master WHERE name = ?"
        described = connection.execute(query, (table,)).fetchone()
        if described is None:
            raise DataError(f"{self.path}: not a rosbag2 database: it has no table {table}")
        kind, definition = (bytes(text or b"").decode(errors="replace") for text in described)
        if kind != "table" or "VIRTUAL" in definition.upper().split("(")[0]:
            raise DataError(f"{self.path}: not a rosbag2 database: {table} is no plain table")
        columns = {
            bytes(name).decode(errors="replace"): hidden
            for _, name, *_, hidden in connection.execute(f"PRAGMA table_xinfo({table})")
        }
        absent = sorted(name for name in needed if columns.get(name, 1) != 0)
        if absent:
            listed = ", ".join(absent)
            raise DataError(f"{self.path}: not a rosbag2 database: {table} has no column {listed}")

    def _messages(
        self, connection: sqlite3.Connection, topics: dict[int, str]
    ) -> Iterator[tuple[str, int, bytes]]:
        """Yield topic, log time, ns, and bytes of all readable rows; skip damaged pages."""
        query = (
            "SELECT rowid, topic_id, timestamp, data FROM messages NOT INDEXED "
            f"WHERE rowid > ? AND topic_id IN ({', '.join('?' * len(topics))}) ORDER BY rowid"
        )
        last, step = -1, _FIRST_STEP
        while topics:
            try:
                for row in connection.execute(query, (last, *topics)):
                    last, number, stamp, data = row
                    step = _FIRST_STEP
                    if isinstance(stamp, int) and isinstance(data, bytes):
                        yield topics[number], stamp, data
                    else:
                        self.damaged += 1
                return
            except sqlite3.DatabaseError:
                self.damaged += 1 if step == _FIRST_STEP else 0
                last, step = last + step, 2 * step
                if step > 1 << 40 or self.damaged > _MOST_HOLES:
                    self.truncated = True
                    return


def _in_batches(messages: Iterator[tuple[str, int, bytes]]) -> Iterator[tuple[str, MessageBatch]]:
    """Group messages (topic, log time in ns, bytes) by topic, up to 20,000 at a time."""
    while True:
        by_topic: dict[str, list[tuple[int, bytes]]] = {}
        size = 0
        for topic, stamp, data in islice(messages, _TOGETHER):
            by_topic.setdefault(topic, []).append((stamp, data))
            size += len(data)
            if size > _BYTES_TOGETHER:
                break
        if not by_topic:
            return
        for topic, given in by_topic.items():
            yield topic, MessageBatch.of(sorted(given, key=lambda message: message[0]))
