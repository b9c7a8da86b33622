"""A recording that was given up is told from a whole one, on disk and by who hears of it."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from rosbags.highlevel import AnyReader
from sensor_msgs.msg import JointState

from idim_iv_interfaces.msg import BagClosed
from idim_iv_ros.nodes.recorder.node import Recorder
from tests.ros.processes import Observer


@pytest.fixture
def recorder(observer: Observer, bags: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Recorder]:
    """One in this process, whose callbacks the observer runs."""
    monkeypatch.chdir(bags)
    recorder = Recorder()
    observer.executor.add_node(recorder.node)
    yield recorder
    observer.executor.remove_node(recorder.node)
    recorder.close()


@pytest.mark.parametrize(("service", "whole"), [("stop", True), ("abort", False)])
def test_folder_and_announcement_tell_a_bag_that_was_given_up(
    recorder: Recorder, observer: Observer, bags: Path, service: str, whole: bool
) -> None:
    session = recorder._session
    publisher = observer.node.create_publisher(JointState, "/joint_states", 10)
    closed: list[BagClosed] = []
    heard = observer.node.create_subscription(BagClosed, "/recorder/bag_closed", closed.append, 10)
    observer.until(publisher.get_subscription_count, "the recorder")
    observer.until(heard.get_publisher_count, "the announcements")
    recorder.act("start")
    name = session.bag.folder.name
    publisher.publish(JointState(name=["a"], position=[1.0]))
    observer.until(lambda: session.recorded("/joint_states"), "the message")
    answer = recorder.act(service)
    observer.until(lambda: closed, "the announcement")
    bag = bags / (name if whole else f"{name}_aborted")
    assert list(bags.iterdir()) == [bag]
    assert str(bag) in answer
    assert (closed[0].bag, closed[0].complete, closed[0].messages) == (str(bag), whole, 1)
    with AnyReader([bag]) as reader:
        assert reader.message_count == 1
    observer.node.destroy_publisher(publisher)
    observer.node.destroy_subscription(heard)


def test_bag_that_was_given_up_is_marked_when_its_folder_cannot_be_renamed(
    recorder: Recorder, bags: Path
) -> None:
    recorder.act("start")
    folder = recorder._session.bag.folder
    taken = folder.with_name(f"{folder.name}_aborted")
    taken.mkdir()
    (taken / "file").write_text("in the way")
    closed: list = []
    recorder._session._closed = lambda bag, faulty: closed.append((bag.folder, faulty))
    recorder.act("abort")
    assert closed == [(folder, True)]
    assert all(path.is_dir() for path in bags.iterdir())
