"""ROS 1's .bag files, through rosbags: message by message, as ROS 2 would have serialised them."""

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

from rosbags.interfaces import Connection
from rosbags.rosbag1 import Reader, ReaderError
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from idim_iv_ros.errors import DataError
from idim_iv_ros.recording.bags.bag_file import BagFile, MessageBatch, in_batches
from idim_iv_ros.recording.bags.definitions import SchemaText, note_type

_HEADER = (
    *("builtin_interfaces/msg/Time", "builtin_interfaces/msg/Duration", "std_msgs/msg/Header"),
)


class Ros1File(BagFile):
    """One .bag file of ROS 1."""

    def summarised_topics(self) -> dict[str, str]:
        """Type of each topic, from the index of the file."""
        with self._opened():
            return dict(self.topics)

    def batches(self, wanted: set[str]) -> Iterator[tuple[str, MessageBatch]]:
        """Raw messages of the wanted topics as ROS 2 serialises them; otherwise as `BagFile`."""
        with self._opened() as reader:
            connections = [
                connection for connection in reader.connections if connection.topic in wanted
            ]
            if not connections:
                return
            self.missing = Counter()
            for connection in connections:
                self.missing[connection.topic] += connection.msgcount
            yield from in_batches(self._messages(reader, connections))

    def _messages(
        self, reader: Reader, connections: Sequence[Connection]
    ) -> Iterator[tuple[str, int, bytes]]:
        serialise = {connection.id: _serialiser(connection) for connection in connections}
        messages = reader.messages(connections)
        while True:
            try:
                connection, stamp, raw = next(messages)
            except StopIteration:
                return
            except Exception:  # what rosbags and decompressors raise has no common class
                self.damaged += 1
                return
            try:
                data = serialise[connection.id](raw)
            except Exception:
                self.damaged += 1
                continue
            self.missing[connection.topic] -= 1
            yield connection.topic, stamp, data

    @contextmanager
    def _opened(self) -> Iterator[Reader]:
        reader = Reader(self.path)
        try:
            reader.open()
        except Exception as error:
            if isinstance(error, OSError):
                raise
            reason = str(error) if isinstance(error, ReaderError) else "its index is damaged"
            raise DataError(
                f"{self.path}: not a ROS 1 bag that can be read ({reason.rstrip('.')}); "
                "`rosbag reindex` mends the index of one that was not closed"
            ) from error
        try:
            for connection in reader.connections:
                note_type(self.topics, connection.topic, connection.msgtype)
                self.definitions[connection.msgtype] = _definition(connection)
            yield reader
        finally:
            reader.close()


def _definition(connection: Connection) -> SchemaText:
    """Return the definition of a type, with the header of ROS 2: it has no number (seq)."""
    parts = connection.msgdef.data.split(f"{'=' * 80}\n")
    kept = [part for part in parts if not part.startswith("MSG: std_msgs/Header\n")]
    return SchemaText("ros2msg", f"{'=' * 80}\n".join(kept))


def _serialiser(connection: Connection) -> Callable[[bytes], bytes]:
    """Return what makes CDR of a message in ROS 1's own form."""
    kind = connection.msgtype
    store, standard = get_typestore(Stores.EMPTY), get_typestore(Stores.ROS2_JAZZY).fielddefs
    store.register({name: standard[name] for name in _HEADER})
    types = get_types_from_msg(_definition(connection).text, kind)
    store.register({name: kind for name, kind in types.items() if name not in _HEADER})
    return lambda raw: bytes(store.ros1_to_cdr(raw, kind))
