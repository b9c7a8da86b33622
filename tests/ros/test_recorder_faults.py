"""Whatever happens to disk, robot and recorder: it is said, and what arrived is kept."""

import os
from pathlib import Path

import numpy as np
from rclpy.qos import QoSProfile
from rosbags.highlevel import AnyReader
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from tests.ros.processes import numbers, only_bag

WARN, ERROR = 1, 2


def test_killed_recorder_loses_at_most_the_last_chunk(
    mortal_recorder, robot, observer, bags: Path, mortal: tuple[Path, str]
) -> None:
    configuration, topic = mortal
    process = mortal_recorder(record=True, chunk_duration=0.3, configuration=configuration)
    topics = [{"name": topic}]
    robot.begin(count=700, topics=topics).run()
    observer.received(700, topic)
    observer.until(lambda: observer.next_status().waiting == 0, "the end of a chunk")
    robot.begin(count=300, topics=topics).run()
    observer.received(1000, topic)
    process.kill()
    bag = only_bag(bags)
    written = numbers(bag, topic)
    assert len(written) >= 700
    assert np.array_equal(written, np.r_[np.arange(700.0), np.arange(300.0)][: len(written)])
    (file,) = bag.glob("*.mcap")
    for path in (bag, file):
        with AnyReader([path]) as reader:
            assert sum(1 for _ in reader.messages()) == len(written)


def test_recording_stops_before_the_disk_is_full(recorder, robot, observer, small_disk) -> None:
    recorder(bag_directory=str(small_disk), minimum_free_disk=2_000_000, chunk_duration=0.2)
    robot.begin(count=200)
    observer.call("start")
    robot.run()
    observer.received(200)
    (small_disk / "ballast").write_bytes(bytes(4_500_000))
    observer.until(lambda: observer.closed, "the announcement")
    observer.diagnosed("recording", "minimum_free_disk is 2 MB", ERROR)
    assert observer.next_status().dropped == 0
    assert not observer.closed[0].complete
    assert np.array_equal(numbers(Path(observer.closed[0].bag)), np.arange(200.0))
    observer.refused("start", "of free disk")


def test_messages_wait_in_memory_while_the_disk_is_full(
    recorder, robot, observer, small_disk
) -> None:
    recorder(bag_directory=str(small_disk), chunk_duration=0.2)
    joints = [f"joint_{k}" for k in range(30)]
    robot.begin(count=3000, rate=1000.0, topics=[{"name": "/joint_states", "joints": joints}])
    observer.call("start")
    ballast = small_disk / "ballast"
    ballast.write_bytes(bytes(os.statvfs(small_disk).f_bavail * 4096 - 8192))
    robot.run()
    observer.received(3000)
    observer.diagnosed("recording", "messages wait in memory", ERROR)
    bag = only_bag(small_disk)
    assert len(numbers(bag)) < 3000
    ballast.unlink()
    observer.until(lambda: not observer.next_status().fault, "the end of the fault")
    observer.call("stop")
    assert np.array_equal(numbers(bag), np.arange(3000.0))


def test_publisher_that_returns_best_effort_is_subscribed_anew_and_one_that_leaves_is_reported(
    recorder, robot, observer, bags: Path
) -> None:
    recorder(record=True)
    robot.begin(count=100).run()
    observer.received(100)
    robot.begin(count=100, topics=[{"name": "/joint_states", "qos": "best_effort"}]).run()
    observer.received(200)
    observer.diagnosed("/joint_states", "QoS of its publisher changed", WARN)
    observer.call("stop")
    assert len(numbers(only_bag(bags))) == 200
    robot.end()
    observer.diagnosed("/joint_states", "its publisher is gone", ERROR)


def test_publishers_with_different_qos_are_all_heard(recorder, robot, observer, bags: Path) -> None:
    recorder(record=True)
    both = [{"name": "/joint_states", "qos": qos} for qos in ("reliable", "best_effort")]
    robot.begin(count=100, topics=both).run()
    observer.received(200)
    observer.diagnosed("/joint_states", "its publishers offer different QoS", WARN)
    observer.diagnosed("/joint_states", "2 publishers: lost messages cannot be counted", WARN)
    observer.call("stop")
    assert np.array_equal(np.sort(numbers(only_bag(bags))), np.repeat(np.arange(100.0), 2))


def test_content_that_changes_and_a_clock_that_jumps_back_are_reported_and_nothing_is_lost(
    recorder, robot, observer, bags: Path, configuration: Path
) -> None:
    recorder(record=True, configuration=str(configuration))
    robot.begin(count=100, stamp_shift={"60": -5.0}).run()
    observer.received(100)
    observer.diagnosed("/joint_states", "1 messages stamped before the one before", WARN)
    effort = [1.0, float("nan")]
    robot.begin(count=50, topics=[{"name": "/joint_states", "effort": effort}]).run()
    observer.diagnosed("/joint_states", "effort of b is NaN", WARN)
    robot.begin(count=50, topics=[{"name": "/joint_states", "joints": ["a", "c"]}]).run()
    observer.diagnosed("/joint_states", "it does not hold joint b", WARN)
    observer.received(200)
    observer.call("stop")
    expected = np.r_[np.arange(100.0), np.arange(50.0), np.arange(50.0)]
    assert np.array_equal(numbers(only_bag(bags)), expected)


def test_malformed_and_huge_messages_harm_nothing(recorder, robot, observer, bags: Path) -> None:
    recorder(record=True, max_message_size=100_000)
    raw = observer.node.create_publisher(JointState, "/joint_states", QoSProfile(depth=100))
    observer.until(lambda: raw.get_subscription_count() == 1, "the recorder")
    random = np.random.default_rng(0)
    for size in (0, 1, 4, 5, 11, 12, 30, 1000, 50_000):
        raw.publish(b"\0\1\0\0" + random.bytes(size))
    raw.publish(b"\0\1\0\0" + b"\xff" * 60)
    raw.publish(bytes(20_000_000))
    observer.until(lambda: observer.topic("/joint_states").malformed == 11, "")
    observer.node.destroy_publisher(raw)
    robot.begin(count=100).run()
    observer.received(110)
    observer.call("stop")
    with AnyReader([only_bag(bags)]) as reader:
        states = [c for c in reader.connections if c.topic == "/joint_states"]
        assert sum(connection.msgcount for connection in states) == 110


def test_wrong_type_on_a_topic_is_reported(recorder, observer) -> None:
    recorder()
    wrong = observer.node.create_publisher(String, "/joint_states", 10)
    observer.diagnosed("/joint_states", "sensor_msgs/msg/JointState is needed", ERROR)
    observer.node.destroy_publisher(wrong)
