"""Bags as drivers and recorders really leave them, written with rosbags' own writers."""

from pathlib import Path

import numpy as np
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

STORE = get_typestore(Stores.ROS2_JAZZY)
TYPES = STORE.types
NAMES = ("a", "b")


def header(stamp: float, types=TYPES):
    """A header with a stamp in s."""
    nanoseconds = round(stamp * 1e9)
    time = types["builtin_interfaces/msg/Time"](
        sec=nanoseconds // 10**9, nanosec=nanoseconds % 10**9
    )
    return types["std_msgs/msg/Header"](stamp=time, frame_id="")


def joint_state(stamp: float, names=NAMES, position=None, velocity=(), effort=None):
    """A JointState whose values tell joint and time: position = stamp + 10 per joint."""
    index = {"a": 0.0, "b": 1.0, "c": 2.0}
    if position is None:
        position = [stamp + 10.0 * index[name] for name in names]
    if effort is None:
        effort = [1.0 + stamp + index[name] for name in names]
    return TYPES["sensor_msgs/msg/JointState"](
        header=header(stamp),
        name=list(names),
        position=np.array(position, dtype=float),
        velocity=np.array(velocity, dtype=float),
        effort=np.array(effort, dtype=float),
    )


def float_array(values):
    """A Float64MultiArray as ros2_control publishes it."""
    layout = TYPES["std_msgs/msg/MultiArrayLayout"](dim=[], data_offset=0)
    return TYPES["std_msgs/msg/Float64MultiArray"](
        layout=layout, data=np.array(values, dtype=float)
    )


def write(folder: Path, messages, storage=StoragePlugin.MCAP, store=STORE) -> Path:
    """Write (topic, log time in s, message) into a rosbag2 folder."""
    with Writer(folder, version=9, storage_plugin=storage) as writer:
        connections = {}
        for topic, stamp, message in messages:
            kind = message.__msgtype__
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=store)
            raw = store.serialize_cdr(message, kind)
            writer.write(connections[topic], round(stamp * 1e9), raw)
    return folder


def steady(count: int = 200, rate: float = 100.0, **keywords):
    """`count` messages on /joint_states at `rate`, starting at 1 s."""
    stamps = [1.0 + k / rate for k in range(count)]
    return [("/joint_states", 5.0 + s, joint_state(s, **keywords)) for s in stamps]
