"""Messages of a topic become numbers in the order of the joints, whatever else it holds."""

from collections.abc import Callable
from types import SimpleNamespace

import numpy as np
import pytest

from idim_iv_ros.nodes import joint_topic
from idim_iv_ros.nodes.joint_topic import JointTopic
from idim_iv_ros.recording.writing.write import Definition, TopicChannel
from tests.recording.control_messages import ControlBag

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


def test_joints_in_messages_of_their_own_are_told_apart(topic) -> None:
    bag = ControlBag()
    bag.joint_state(1.0, ["b"], [2.0], effort=[20.0])
    bag.joint_state(1.0, ["gripper"], [0.5], effort=[0.1])
    bag.joint_state(1.001, ["a"], [1.0], effort=[10.0])
    made = topic(bag, BOTH)
    taken = made.take()["position"]
    assert taken.time.tolist() == [1_000_000_000, 1_001_000_000]
    assert np.array_equal(taken.named, [[False, True], [True, False]])
    assert made.problem == ""


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
