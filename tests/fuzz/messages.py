"""Messages as bytes, and bags that hold any bytes."""

import sqlite3
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from mcap.writer import CompressionType, Writer

from idim_iv_ros.recording.writing.write import TopicChannel
from tests.fuzz.case import JOINTS, Good
from tests.recording.bag_writer import STORE, TYPES, joint_state

STATES, REFERENCE = "/joint_states", "/joint_reference"
STATE_TYPE = "sensor_msgs/msg/JointState"


@dataclass(frozen=True)
class Raw:
    """One message: topic, log time in ns, bytes, type."""

    topic: str
    arrival: int
    payload: bytes
    kind: str = STATE_TYPE


@dataclass
class State:
    """A joint state before it becomes bytes; fields may disagree in length."""

    topic: str
    stamp: float
    position: np.ndarray
    effort: np.ndarray
    names: Sequence[str] = JOINTS
    velocity: Sequence[float] = ()
    arrival: float | None = None


def states(good: Good) -> list[State]:
    """All messages of the good bag in the order of their stamps."""
    messages = []
    for k, stamp in enumerate(good.time):
        messages.append(State(STATES, stamp, good.position[k], good.effort[k]))
        messages.append(State(REFERENCE, stamp, good.reference[k], np.zeros(0)))
    return messages


def raw(states: Sequence[State]) -> list[Raw]:
    """Serialise messages; stamps out of the range of ROS are clipped to it."""
    serialised = []
    for state in states:
        stamp = min(max(state.stamp, -(2.0**31)), 2.0**31 - 1.0)
        message = joint_state(stamp, state.names, state.position, state.velocity, state.effort)
        arrival = stamp if state.arrival is None else state.arrival
        nanoseconds = max(0, min(round(arrival * 1e9), 2**63 - 1))
        serialised.append(
            Raw(state.topic, nanoseconds, bytes(STORE.serialize_cdr(message, STATE_TYPE)))
        )
    return serialised


def text_message(text: str) -> Raw:
    """The /robot_description."""
    kind = "std_msgs/msg/String"
    return Raw(
        "/robot_description", 0, bytes(STORE.serialize_cdr(TYPES[kind](data=text), kind)), kind
    )


def write_mcap(
    path: Path,
    messages: Sequence[Raw],
    *,
    compression: CompressionType = CompressionType.ZSTD,
    schema: tuple[str, str, bytes] | None = None,
    encoding: str = "cdr",
) -> Path:
    """Write an MCAP file of many chunks; `schema` is (name, encoding, data) of all topics."""
    with path.open("wb") as stream:
        writer = Writer(stream, chunk_size=16_384, compression=compression)
        writer.start(profile="ros2", library="fuzz")
        channels: dict[str, int] = {}
        for number, message in enumerate(messages):
            if message.topic not in channels:
                if schema is None and encoding == "cdr":
                    channels[message.topic] = TopicChannel(message.topic, message.kind).register(
                        writer
                    )
                else:
                    name, kind, data = schema or (message.kind, "ros2msg", b"")
                    identity = writer.register_schema(name, kind, data) if name else 0
                    channels[message.topic] = writer.register_channel(
                        message.topic, encoding, identity
                    )
            stamp = message.arrival
            writer.add_message(channels[message.topic], stamp, message.payload, stamp, number)
        writer.finish()
    return path


def write_db3(path: Path, messages: Sequence[Raw], *statements: str) -> Path:
    """Write a rosbag2 database, then run SQL on it."""
    connection = sqlite3.connect(path)
    connection.execute(
        "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL, "
        "serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL)"
    )
    connection.execute(
        "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, "
        "data BLOB)"
    )
    topics = {message.topic: message.kind for message in messages}
    for number, (topic, kind) in enumerate(topics.items(), start=1):
        connection.execute("INSERT INTO topics VALUES (?, ?, ?, 'cdr', '')", (number, topic, kind))
    numbers = {topic: number for number, topic in enumerate(topics, start=1)}
    connection.executemany(
        "INSERT INTO messages(topic_id, timestamp, data) VALUES (?, ?, ?)",
        [(numbers[message.topic], message.arrival, message.payload) for message in messages],
    )
    for statement in statements:
        connection.execute(statement)
    connection.commit()
    connection.close()
    return path
