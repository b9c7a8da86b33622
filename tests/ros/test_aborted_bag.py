"""A recording that was given up is told from a whole one, on disk and by who hears of it."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from rclpy.parameter import Parameter
from rosbags.highlevel import AnyReader
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from idim_iv_interfaces.msg import BagClosed
from idim_iv_ros.nodes.identifier.job_queue import JobQueue
from idim_iv_ros.nodes.identifier.node import Identifier
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
    recorder._start()
    name = session.bag.folder.name
    publisher.publish(JointState(name=["a"], position=[1.0]))
    observer.until(lambda: session.recorded("/joint_states"), "the message")
    answer = getattr(recorder, f"_{service}")()
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
    recorder._start()
    folder = recorder._session.bag.folder
    taken = folder.with_name(f"{folder.name}_aborted")
    taken.mkdir()
    (taken / "file").write_text("in the way")
    closed: list = []
    recorder._session._closed = lambda bag, faulty: closed.append((bag.folder, faulty))
    recorder._abort()
    assert closed == [(folder, True)]
    assert all(path.is_dir() for path in bags.iterdir())


@pytest.mark.parametrize("complete", [True, False])
def test_auto_identifies_whole_bags_only(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, complete: bool
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(JobQueue, "warm", lambda queue: None)
    asked: list[list[str]] = []

    def submit(self: object, kind: object, request: object, listener: object) -> None:
        asked.append(list(request.bags))

    monkeypatch.setattr(Identifier, "_submit", submit)
    identifier = Identifier()
    identifier.node.set_parameters([Parameter("auto", value=True)])
    identifier._bag_closed(BagClosed(bag="/bags/one", complete=complete))
    assert asked == ([["/bags/one"]] if complete else [])
    identifier.close()


def test_recorder_offers_to_give_up(recorder: Recorder, observer: Observer) -> None:
    client = observer.node.create_client(Trigger, "/recorder/abort")
    observer.until(client.service_is_ready, "the service")
    answer = client.call_async(Trigger.Request())
    observer.until(answer.done, "the answer")
    assert not answer.result().success  # nothing is recorded
    observer.node.destroy_client(client)
