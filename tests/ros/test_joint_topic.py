"""Messages of a topic become numbers in the order of the joints, whatever else it holds."""

from collections.abc import Callable
from contextlib import ExitStack
from types import SimpleNamespace

import numpy as np
import pytest
from rclpy.duration import Duration
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectoryPoint

from idim_iv_ros.nodes import joint_topic
from idim_iv_ros.nodes.joint_topic import JointPositions, JointTopic
from idim_iv_ros.recording.writing.write import Definition, TopicChannel
from tests.recording.control_messages import ControlBag
from tests.ros.processes import HANG, LATCHED, Observer

JOINTS = ["a", "b"]


class Waiting:
    """In the place of a subscription: messages that wait."""

    problem, publishers = "", 1

    def __init__(self, *_: object, best_effort: bool) -> None:
        self.channel = TopicChannel("/states", "")
        self.messages: list = []

    def take(self, largest: int) -> list:
        taken, self.messages = self.messages, []
        times = {"publication_sequence_number": 0, "received_timestamp": 9}
        return [(raw, {**times, "source_timestamp": 5 + k}) for k, raw in enumerate(taken)]


@pytest.fixture
def topic(monkeypatch: pytest.MonkeyPatch) -> Callable[..., JointTopic]:
    """Make a topic and put messages of a bag on it."""
    monkeypatch.setattr(joint_topic, "WatchedTopic", Waiting)
    node = SimpleNamespace(resolve_topic_name=lambda name: f"/{name.strip('/')}")

    def make(bag: ControlBag, fields: dict, **options: bool) -> JointTopic:
        made = JointTopic(node, "states", JOINTS, fields, **options)
        kinds = [message.__msgtype__ for _, _, message in bag.messages]
        text, _ = bag.store.generate_msgdef(kinds[0], ros_version=2)
        made._topic.channel = TopicChannel("/states", kinds[0], defined=Definition(text, ""))
        made._topic.messages = [
            bytes(bag.store.serialize_cdr(message, kind))
            for (_, _, message), kind in zip(bag.messages, kinds, strict=True)
        ]
        return made

    return make


BOTH = {"position": None, "effort": None}


def test_joints_are_found_by_name_and_other_parts_left_out(topic) -> None:
    bag = ControlBag()
    bag.joint_state(1.0, ["b", "x", "a"], [2.0, 9.0, 1.0], effort=[20.0, 90.0, 10.0])
    bag.joint_state(1.001, ["gripper"], [0.5], effort=[0.1])
    bag.joint_state(1.002, ["a", "b"], [1.5, np.nan], effort=[11.0, np.nan])
    made = topic(bag, BOTH)
    taken = made.take()
    assert taken["position"].time.tolist() == [1_000_000_000, 1_002_000_000]
    assert np.array_equal(taken["position"].values, [[1.0, 2.0], [1.5, np.nan]], equal_nan=True)
    assert np.array_equal(taken["effort"].values, [[10.0, 20.0], [11.0, np.nan]], equal_nan=True)
    assert made.problem == ""
    assert len(made.take()["effort"]) == 0


def test_a_gripper_between_two_messages_of_the_arm_is_no_problem(topic) -> None:
    arm, gripper = ControlBag(), ControlBag()
    arm.joint_state(1.0, JOINTS, [1.0, 2.0], effort=[1.0, 2.0])
    gripper.joint_state(1.001, ["gripper"], [0.5], effort=[0.1])
    made, other = topic(arm, BOTH), topic(gripper, BOTH)
    assert made.take()["position"].named is None
    made._topic.messages = other._topic.messages
    assert len(made.take()["position"]) == 0
    assert made.problem == ""


def test_what_is_missing_is_named(topic) -> None:
    bag = ControlBag()
    bag.joint_state(1.0, ["a", "gripper"], [1.0, 2.0], effort=[1.0, 2.0])
    bag.joint_state(1.001, ["gripper"], [2.0], effort=[2.0])
    taken = topic(bag, BOTH).take()
    assert np.array_equal(taken["position"].values, [[1.0, np.nan]], equal_nan=True)
    bag = ControlBag()
    bag.joint_state(1.0, ["gripper"], [2.0], effort=[2.0])
    made = topic(bag, BOTH)
    assert len(made.take()["position"]) == 0
    assert made.problem == "/states: it does not hold joint a, b"


def test_stamps_that_are_not_filled_in_are_those_of_the_middleware(topic) -> None:
    bag = ControlBag()
    bag.joint_state(0.0, JOINTS, [1.0, 2.0], effort=[1.0, 2.0])
    assert topic(bag, BOTH).take()["position"].time.tolist() == [5]


def test_damaged_messages_are_counted(topic) -> None:
    bag = ControlBag()
    bag.joint_state(1.0, JOINTS, [1.0, 2.0], effort=[1.0, 2.0])
    made = topic(bag, BOTH)
    made._topic.messages.insert(0, b"\0\1\0\0nonsense")
    assert len(made.take()["position"]) == 1
    assert made.damaged == 1


ALL = Duration(seconds=HANG)


def test_positions_are_read_from_a_named_field_of_any_type(
    observer: Observer, stack: ExitStack
) -> None:
    node = observer.node
    publisher = node.create_publisher(JointTrajectoryPoint, "/arm/point", 1)
    stack.callback(node.destroy_publisher, publisher)
    places = JointPositions(node, "/arm/point#positions", JOINTS)
    stack.callback(places.close)
    assert places.topic == "/arm/point"
    assert places.age() == float("inf")

    def heard() -> bool:
        publisher.publish(JointTrajectoryPoint(positions=[1.0, 2.0], effort=[5.0, 6.0]))
        return places.last is not None

    observer.until(heard, "positions")
    assert places.last.position.tolist() == [1.0, 2.0]
    assert places.age() < float("inf")
    assert places.problem == ""


def test_old_news_is_no_news(observer: Observer, stack: ExitStack) -> None:
    """Neither a message from before anybody listened, nor one that is repeated."""
    node = observer.node
    publisher = node.create_publisher(JointState, "/arm/latched", LATCHED)
    stack.callback(node.destroy_publisher, publisher)
    message = JointState(name=["b", "a"], position=[2.0, 1.0])
    message.header.stamp = node.get_clock().now().to_msg()
    publisher.publish(message)
    places = JointPositions(node, "/arm/latched", JOINTS)
    stack.callback(places.close)
    observer.until(lambda: publisher.get_subscription_count() > 0, "a subscription")
    places._look()
    assert places.last is None
    publisher.publish(message)
    observer.until(lambda: places.last is not None, "positions")
    first = places.last
    assert first.position.tolist() == [1.0, 2.0]
    publisher.publish(message)
    publisher.wait_for_all_acked(ALL)
    places._look()
    assert places.last is first


def test_reason_is_named(observer: Observer, stack: ExitStack) -> None:
    places = JointPositions(observer.node, "/arm/nothing", JOINTS)
    stack.callback(places.close)
    assert places.problem == "nobody publishes /arm/nothing"
    publisher = observer.node.create_publisher(JointState, "/arm/nothing", 1)
    stack.callback(observer.node.destroy_publisher, publisher)

    def other() -> bool:
        publisher.publish(JointState(name=["a"], position=[1.0]))
        return places.problem == "/arm/nothing: no position of b"

    observer.until(other, "a reason")
    assert places.last is None
