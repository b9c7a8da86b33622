"""The last seconds in memory: how many are kept, and when they are written."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rosbags.highlevel import AnyReader
from sensor_msgs.msg import JointState

from idim_iv_interfaces.msg import BagClosed
from idim_iv_ros.nodes.recorder.node import Recorder
from idim_iv_ros.nodes.recorder.session import SnapshotRing
from idim_iv_ros.recording.writing.write import TopicChannel
from tests.ros.processes import Observer, numbers

TOPIC = TopicChannel("/joint_states", "sensor_msgs/msg/JointState")


def messages(first: int, count: int, size: int = 100):
    """`count` messages a millisecond apart."""
    return [(k * 1_000_000, TOPIC.name, bytes(size), 0, k) for k in range(first, first + count)]


def test_a_ring_keeps_the_seconds_that_are_asked_for() -> None:
    ring = SnapshotRing(2.0, 10**9)
    for first in range(0, 5000, 100):
        ring.add([TOPIC], messages(first, 100))
    _, kept = ring.content()
    # A batch is kept as long as its newest message is young enough.
    assert 2.0 <= ring.span <= 2.1
    assert [message[4] for message in kept] == list(range(5000 - len(kept), 5000))


def test_a_ring_keeps_no_more_than_its_memory() -> None:
    ring = SnapshotRing(3600.0, 1_000_000)
    for first in range(0, 5000, 100):
        ring.add([TOPIC], messages(first, 100, size=1000))
        assert ring.size <= 1_000_000
    _, kept = ring.content()
    assert 600 <= len(kept) <= 1000
    assert kept[-1][4] == 4999


def test_a_snapshot_is_a_bag_of_the_last_seconds_while_nothing_is_recorded(
    recorder, robot, observer, bags: Path
) -> None:
    recorder(snapshot_duration=0.5, bag_prefix="arm")
    robot.begin(count=500, description="<robot name='x'/>").run()
    observer.received(500)
    arrived = observer.status.header.stamp.sec + 1e-9 * observer.status.header.stamp.nanosec

    def old() -> bool:
        stamp = observer.next_status().header.stamp
        return stamp.sec + 1e-9 * stamp.nanosec > arrived + 0.6

    observer.until(old, "messages that are too old")
    robot.begin(count=200, description="<robot name='x'/>").run()
    observer.received(700)
    observer.call("snapshot")
    observer.until(lambda: observer.closed, "the announcement")
    (closed,) = observer.closed
    bag = Path(closed.bag)
    assert (bag.parent, closed.complete) == (bags, True)
    assert bag.name.startswith("arm_snapshot_")
    kept = numbers(bag)
    assert 0 < len(kept) <= 200
    assert np.array_equal(kept, np.arange(200.0 - len(kept), 200.0))
    with AnyReader([bag]) as reader:
        assert {c.topic for c in reader.connections} == {"/joint_states", "/robot_description"}


def test_recording_goes_on_without_loss_while_a_snapshot_is_written(
    recorder, robot, observer, bags: Path
) -> None:
    recorder(snapshot_duration=30.0, record=True)
    robot.begin(count=2000, rate=1000.0, pace=True)
    robot.say("go")
    observer.until(lambda: observer.topic("/joint_states").received > 500, "500 messages")
    observer.call("snapshot")
    assert robot.sent() == 2000
    observer.received(2000)
    observer.until(lambda: observer.closed, "the snapshot")
    observer.call("stop")
    observer.until(lambda: len(observer.closed) == 2, "the recording")
    snapshot, whole = (Path(closed.bag) for closed in observer.closed)
    assert "snapshot" in snapshot.name
    assert np.array_equal(numbers(whole), np.arange(2000.0))
    assert np.array_equal(numbers(snapshot), np.arange(float(len(numbers(snapshot)))))


def test_a_snapshot_of_nothing_is_refused_and_an_error_of_another_node_writes_one(
    mortal_recorder, robot, observer, bags: Path
) -> None:
    mortal_recorder(snapshot_on_error=True)
    observer.refused("snapshot", "snapshot_duration is 0")
    assert observer.set(snapshot_duration=30.0)[0].successful
    observer.refused("snapshot", "no snapshot: no message has arrived")
    robot.begin(count=200)
    robot.run()
    observer.received(200)
    publisher = observer.node.create_publisher(DiagnosticArray, "/diagnostics", 10)
    status = DiagnosticStatus(name="drive 3", level=DiagnosticStatus.ERROR, message="too hot")

    def announced() -> list:
        publisher.publish(DiagnosticArray(status=[status]))
        return observer.closed

    observer.until(announced, "the snapshot")
    assert np.array_equal(numbers(Path(observer.closed[0].bag)), np.arange(200.0))
    # The error goes on: the next snapshot is the one that is asked for.
    observer.call("snapshot")
    observer.until(lambda: len(observer.closed) > 1, "the second")
    assert len(observer.closed) == 2
    observer.node.destroy_publisher(publisher)


@pytest.fixture
def recorder_here(
    observer: Observer, bags: Path, monkeypatch: pytest.MonkeyPatch
) -> Iterator[Recorder]:
    """One in this process, whose callbacks the observer runs."""
    monkeypatch.chdir(bags)
    recorder = Recorder()
    observer.executor.add_node(recorder.node)
    yield recorder
    observer.executor.remove_node(recorder.node)
    recorder.close()


@pytest.mark.parametrize(("service", "whole"), [("stop", True), ("abort", False)])
def test_folder_and_announcement_tell_a_bag_that_was_given_up(
    recorder_here: Recorder, observer: Observer, bags: Path, service: str, whole: bool
) -> None:
    session = recorder_here._session
    publisher = observer.node.create_publisher(JointState, "/joint_states", 10)
    closed: list[BagClosed] = []
    heard = observer.node.create_subscription(BagClosed, "/recorder/bag_closed", closed.append, 10)
    observer.until(publisher.get_subscription_count, "the recorder")
    observer.until(heard.get_publisher_count, "the announcements")
    recorder_here.act("start")
    name = session.bag.folder.name
    publisher.publish(JointState(name=["a"], position=[1.0]))
    observer.until(lambda: session.recorded("/joint_states"), "the message")
    answer = recorder_here.act(service)
    observer.until(lambda: closed, "the announcement")
    bag = bags / (name if whole else f"{name}_aborted")
    assert list(bags.iterdir()) == [bag]
    assert str(bag) in answer
    assert (closed[0].bag, closed[0].complete, closed[0].messages) == (str(bag), whole, 1)
    with AnyReader([bag]) as reader:
        assert reader.message_count == 1
    observer.node.destroy_publisher(publisher)
    observer.node.destroy_subscription(heard)
