"""What the recorder says of the joints on a topic that several publishers share."""

from collections.abc import Sequence

import numpy as np

from idim_iv_ros.nodes.recorder.topic_monitor import JointContent
from idim_iv_ros.recording.bags.definitions import JOINT_STATE
from tests.recording.bag_writer import STORE, joint_state

BOTH = ["position", "effort"]


def message(*names: str, effort: Sequence[float] | None = None) -> bytes:
    values = np.zeros(len(names))
    made = joint_state(1.0, names, values, effort=values if effort is None else effort)
    return bytes(STORE.serialize_cdr(made, JOINT_STATE))


def test_a_gripper_of_its_own_is_no_change_of_the_joints() -> None:
    content = JointContent(JOINT_STATE, ["a", "b"], BOTH)
    for latest in (message("a", "b"), message("finger", effort=[])) * 3:
        content.look([latest])
        assert content.problems == []
    content.reset()
    content.look([message("finger", effort=[])])
    assert content.problems == []


def test_an_arm_in_two_messages_holds_all_joints_and_what_one_lacks_is_named() -> None:
    content = JointContent(JOINT_STATE, ["a", "b", "c"], BOTH)
    content.look([message("a", "b"), message("c")])
    assert content.problems == []
    content.look([message("c", effort=[np.nan])])
    assert content.problems == ["effort of c is NaN"]


def test_a_joint_that_is_lost_and_found_again_is_said_until_the_next_bag() -> None:
    content = JointContent(JOINT_STATE, ["a", "b"], BOTH)
    content.look([message("a", "b"), message("a")])
    changed = "the set of joints changed: a, b / a"
    assert content.problems == ["it does not hold joint b", changed]
    content.reset()
    assert content.problems == ["it does not hold joint b"]
    content.look([message("a", "b")])
    assert content.problems == ["the set of joints changed: a / a, b"]
    content.reset()
    assert content.problems == []


def test_messages_of_several_parts_are_read_once_each() -> None:
    content = JointContent(JOINT_STATE, ["a", "b"], BOTH)
    read: list[bytes] = []
    take = content._read
    content._read = lambda raw: (read.append(raw), take(raw))
    parts = [message("a", "b"), message("finger", effort=[])]
    for _ in range(20):
        content.look(parts)
    assert len(read) == 2
