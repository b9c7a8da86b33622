"""The recorder that one would write first: a raw subscription whose callback writes each message.

Run as ``python plain_recorder.py FILE``; SIGINT ends it and prints how many messages it wrote.
"""

import signal
import sys
import threading
import time

import rclpy
from mcap.writer import CompressionType, Writer
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import QoSProfile
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import JointState

from idim_iv_ros.recording.writing.write import TopicChannel


def main() -> None:
    stop = threading.Event()
    signal.signal(signal.SIGINT, lambda *_: stop.set())
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    node = rclpy.create_node("plain")
    written = 0
    with open(sys.argv[1], "wb") as stream:  # noqa: PTH123
        writer = Writer(stream, compression=CompressionType.ZSTD)
        writer.start(profile="ros2", library="plain")
        channel = TopicChannel("/joint_states", "sensor_msgs/msg/JointState").register(writer)

        def write(message: bytes) -> None:
            nonlocal written
            now = time.time_ns()
            writer.add_message(channel, now, message, now, written)
            written += 1

        qos = QoSProfile(depth=20_000)
        node.create_subscription(JointState, "/joint_states", write, qos, raw=True)
        executor = SingleThreadedExecutor()
        executor.add_node(node)
        while not stop.is_set():
            executor.spin_once(timeout_sec=0.2)
        writer.finish()
    print(written, flush=True)


main()
