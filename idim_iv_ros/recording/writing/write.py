"""Writing recordings as MCAP bags that ROS 2 tools open."""

import json
import struct
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import IO, cast

import numpy as np
from mcap.writer import CompressionType, Writer
from numpy.typing import NDArray
from rosbags.typesys import Stores, get_typestore

from idim_iv_ros.files import (
    PROGRAM,
    FilePath,
    complete_files,
    refused_if_unwritable,
    require_replaceable,
)
from idim_iv_ros.recording.bags.joint_message_type import JOINT_STATE
from idim_iv_ros.recording.request import in_root
from idim_iv_ros.types import FloatArray, IntArray

_STRING = "std_msgs/msg/String"
_FOREVER = {"sec": 9223372036, "nsec": 854775807}
# A damaged byte costs the messages of one chunk: chunks are short.
_CHUNK_DURATION = 1_000_000_000  # ns of log time


@dataclass(frozen=True)
class Storage:
    """Compression of chunks, and the size in bytes at which a chunk ends."""

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


@dataclass(frozen=True)
class OfferedQos:
    """Quality of service of one publisher, as rosbag2 writes it."""

    reliability: str = "reliable"  # or best_effort
    durability: str = "volatile"  # or transient_local
    depth: int = 10  # of its history: discovery does not say it, and no replay needs it

    @property
    def document(self) -> dict[str, object]:
        """Return the QoS as an item of the list ``offered_qos_profiles``."""
        return {
            "history": "keep_last",
            "depth": self.depth,
            "reliability": self.reliability,
            "durability": self.durability,
            "deadline": _FOREVER,
            "lifespan": _FOREVER,
            "liveliness": "automatic",
            "liveliness_lease_duration": _FOREVER,
            "avoid_ros_namespace_conventions": False,
        }


@dataclass(frozen=True)
class Definition:
    """Text of a message type and of the types in it, and its hash (REP 2011)."""

    text: str
    hash: str


@dataclass(frozen=True)
class TopicChannel:
    """One topic of a bag."""

    name: str
    message_type: str
    offered: tuple[OfferedQos, ...] = (OfferedQos(),)  # one for each publisher
    defined: Definition | None = None  # of a type that is not in the standard packages of ROS 2

    @property
    def latched(self) -> bool:
        """Return whether late subscribers get the last message (all transient local)."""
        return {qos.durability for qos in self.offered} == {"transient_local"}

    @property
    def definition(self) -> Definition:
        """Return the definition of the message type."""
        return self.defined or _definition(self.message_type)

    def register(self, writer: Writer) -> int:
        """Describe the topic in an MCAP file and return its channel."""
        schema = writer.register_schema(self.message_type, "ros2msg", self.definition.text.encode())
        metadata = {
            # Every reader of YAML reads JSON.
            "offered_qos_profiles": json.dumps([qos.document for qos in self.offered]),
            "topic_type_hash": self.definition.hash,
        }
        return int(writer.register_channel(self.name, "cdr", schema, metadata))


@cache
def _definition(message_type: str) -> Definition:
    store = get_typestore(Stores.ROS2_JAZZY)
    text, _ = store.generate_msgdef(message_type, ros_version=2)
    return Definition(text, store.hash_rihs01(message_type))


class ShortChunkWriter(Writer):
    """MCAP writer with chunks of at most one second of log time, and about a given size.

    `stream`: has `write`, `tell` and `flush`. `library`: name of the program, in the header.
    `summary_offsets`: whether to write them; they pile up if `finish` is called repeatedly.
    `storage`: compression and size of the chunks.
    """

    def __init__(
        self,
        stream: object,
        *,
        library: str,
        summary_offsets: bool = True,
        storage: Storage = PRESETS["default"],
    ) -> None:
        super().__init__(
            cast(IO[bytes], stream), **vars(storage), use_summary_offsets=summary_offsets
        )
        self._first: int | None = None
        self.start(profile="ros2", library=library)

    def add_message(
        self, channel_id: int, log_time: int, data: bytes, publish_time: int, sequence: int = 0
    ) -> None:
        """Write a message, in a new chunk if the present one is a second long."""
        if self._first is None:
            self._first = log_time
        elif abs(log_time - self._first) >= _CHUNK_DURATION:
            self.flush()
            self._first = log_time
        super().add_message(channel_id, log_time, data, publish_time, sequence)

    def flush(self) -> None:
        """End the present chunk."""
        self._first = None
        super().flush()  # type: ignore[no-untyped-call]


@dataclass(frozen=True)
class JointTopic:
    """One JointState topic to be written; a leading slash is added to a `name` without one.

    `time` (n,) s; `position` (rad or m), `velocity`, `effort`: (n, n_joints) or None.
    """

    name: str
    joints: Sequence[str]
    time: FloatArray
    position: FloatArray | None = None
    velocity: FloatArray | None = None
    effort: FloatArray | None = None


def write_bag(
    out: FilePath,
    topics: Sequence[JointTopic],
    *,
    robot_description: str | None = None,
    force: bool = False,
) -> None:
    """Write JointState topics, and the URDF, into an MCAP bag.

    The file appears under its name only when it is whole.

    Parameters
    ----------
    out : str or Path
    topics : sequence of JointTopic
    robot_description : str or None
        Text of the URDF, for /robot_description.
    force : bool
        Replace a file that this program did not write.

    Raises
    ------
    UsageError
        The file cannot be written, or one of somebody else is in its place.
    """
    out = Path(out)
    require_replaceable([out], force=force)
    with (
        refused_if_unwritable(out),
        complete_files([out]) as temporary,
        temporary[out].open("wb") as stream,
    ):
        write_messages(stream, topics, robot_description)


def write_messages(
    stream: IO[bytes], topics: Sequence[JointTopic], robot_description: str | None
) -> None:
    """Write a bag to a file that is open; see `write_bag`."""
    writer = ShortChunkWriter(stream, library=PROGRAM)
    if robot_description is not None:
        latched = (OfferedQos(durability="transient_local"),)
        channel = TopicChannel("/robot_description", _STRING, latched).register(writer)
        start = int(min(_nanoseconds(topic.time)[0] for topic in topics))
        store = get_typestore(Stores.ROS2_JAZZY)
        text = store.serialize_cdr(store.types[_STRING](data=robot_description), _STRING)
        writer.add_message(channel, start, bytes(text), start)
        # By itself: it is long, and a byte of it shall not cost the first second.
        writer.flush()
    channels = [TopicChannel(in_root(topic.name), JOINT_STATE).register(writer) for topic in topics]
    stamps = [_nanoseconds(topic.time) for topic in topics]
    payloads = [serialised(topic, stamp) for topic, stamp in zip(topics, stamps, strict=True)]
    owner = np.concatenate([np.full(len(s), k) for k, s in enumerate(stamps)])
    number = np.concatenate([np.arange(len(s)) for s in stamps])
    for place in np.argsort(np.concatenate(stamps), kind="stable"):
        topic, message = int(owner[place]), int(number[place])
        stamp, data = int(stamps[topic][message]), payloads[topic][message].tobytes()
        writer.add_message(channels[topic], stamp, data, stamp, sequence=message)
    writer.finish()  # type: ignore[no-untyped-call]


# What no message holds by chance: shows where a quantity begins in a template.
_MARKS = {"position": -1.1e-301, "velocity": -2.2e-302, "effort": -3.3e-303}
_STAMP = 4  # bytes before the stamp


def serialised(topic: JointTopic, stamps: IntArray) -> NDArray[np.uint8]:
    """Return serialised messages (n, size) at stamps (n,), ns, from one template."""
    fields = {"position": topic.position, "velocity": topic.velocity, "effort": topic.effort}
    given = {name: values for name, values in fields.items() if values is not None}
    # A message with marks in the fields that are given.
    store, joints = get_typestore(Stores.ROS2_JAZZY), topic.joints
    stamp = store.types["builtin_interfaces/msg/Time"](sec=0, nanosec=0)
    header = store.types["std_msgs/msg/Header"](stamp=stamp, frame_id="")
    numbers = {
        name: np.full(len(joints) if name in given else 0, mark) for name, mark in _MARKS.items()
    }
    message = store.types[JOINT_STATE](header=header, name=list(joints), **numbers)
    template = bytes(store.serialize_cdr(message, JOINT_STATE, little_endian=True))
    messages = np.tile(np.frombuffer(template, dtype=np.uint8), (len(stamps), 1))
    seconds, nanoseconds = np.divmod(stamps, 1_000_000_000)
    for place, part in ((_STAMP, seconds), (_STAMP + 4, nanoseconds)):
        messages[:, place : place + 4] = part.astype("<u4")[:, None].view(np.uint8)
    for name, values in given.items():
        offset = template.index(struct.pack("<d", _MARKS[name]))
        content = np.ascontiguousarray(values, dtype="<f8").view(np.uint8)
        messages[:, offset : offset + content.shape[1]] = content
    return messages


def _nanoseconds(time: FloatArray) -> IntArray:
    return np.round(np.asarray(time, dtype=float) * 1e9).astype(np.int64)
