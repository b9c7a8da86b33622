"""A robot's publishers in a process of their own: JointState, numbered, stamped at a steady rate.

Each line of JSON on stdin makes a node. It says ``ready`` when every topic has a subscriber,
publishes after ``go``, says how many it sent, and ends its node after ``end``. The messages come as
fast as they can be taken, and none is given up before it was received; or, where the node is to
keep its ``pace``, no faster than their stamps.
"""

import json
import struct
import sys
import time

import numpy as np
import rclpy
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rosbags.typesys import Stores, get_typestore
from sensor_msgs.msg import JointState
from std_msgs.msg import String

HANG = 120.0  # s
BURST = 20  # messages; more of them at once would have to be sent again, which takes seconds

JOINT_STATE = "sensor_msgs/msg/JointState"
STORE = get_typestore(Stores.ROS2_JAZZY)

KIND = {"reliable": ReliabilityPolicy.RELIABLE, "best_effort": ReliabilityPolicy.BEST_EFFORT}


def template(topic: dict) -> tuple[bytearray, int]:
    """A serialised message, and where its first position lies."""
    names = topic.get("joints", ["a", "b"])
    effort = topic.get("effort", [1.0] * len(names))
    mark = 987654.321
    types = STORE.types
    message = types[JOINT_STATE](
        header=types["std_msgs/msg/Header"](
            stamp=types["builtin_interfaces/msg/Time"](sec=0, nanosec=0), frame_id=""
        ),
        name=names,
        position=np.full(len(names), mark),
        velocity=np.zeros(0),
        effort=np.array(effort, dtype=float),
    )
    # rclpy's serialize_message leaves bytes of chance behind the message; publish does not.
    raw = bytearray(STORE.serialize_cdr(message, JOINT_STATE))
    return raw, raw.index(struct.pack("<d", mark))


def main() -> None:
    rclpy.init()
    for line in sys.stdin:
        perform(json.loads(line))


def perform(settings: dict) -> None:
    node = rclpy.create_node(settings["node"])
    publishers = []
    for topic in settings["topics"]:
        reliability = KIND[topic.get("qos", "reliable")]
        depth = topic.get("depth", settings["count"])
        qos = QoSProfile(depth=depth, reliability=reliability)
        publishers.append((node.create_publisher(JointState, topic["name"], qos), topic))
    if "description" in settings:
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        description = node.create_publisher(String, "/robot_description", latched)
        description.publish(String(data=settings["description"]))
    deadline = time.monotonic() + HANG
    while any(p.get_subscription_count() == 0 for p, _ in publishers):
        if time.monotonic() > deadline:
            sys.exit("no subscriber")
        time.sleep(0.01)
    print("ready", flush=True)
    sys.stdin.readline()
    seconds = publish(settings, publishers)
    print(json.dumps({"sent": settings["count"], "seconds": seconds}), flush=True)
    sys.stdin.readline()
    node.destroy_node()
    print("ended", flush=True)


def publish(settings: dict, publishers: list) -> float:
    raws = [template(topic) for _, topic in publishers]
    shift = settings.get("stamp_shift", {})
    rate, count, begin = settings["rate"], settings["count"], time.monotonic()
    # The last stamp is that of now, as if they had come at their rate.
    first = time.time_ns() - (0 if settings["pace"] else int(1e9 * count / rate))
    for number in range(count):
        if settings["pace"]:
            ahead = begin + number / rate - time.monotonic()
            if ahead > 0:
                time.sleep(max(ahead, 0.001))  # in small bursts above 1 kHz: waiting costs nothing
        elif number % BURST == 0:
            time.sleep(0.001)
        stamp = first + int(1e9 * (number / rate + shift.get(str(number), 0.0)))
        for (publisher, _), (raw, place) in zip(publishers, raws, strict=True):
            struct.pack_into("<iI", raw, 4, stamp // 10**9, stamp % 10**9)
            struct.pack_into("<d", raw, place, float(number))
            publisher.publish(bytes(raw))
    return time.monotonic() - begin


main()
