"""What a bag holds besides measurements: the robot's description, and perhaps its reference."""

import re
import struct
from collections.abc import Sequence
from xml.etree import ElementTree

from idim_iv_ros.errors import DataError
from idim_iv_ros.recording.bags.cdr import JOINT_STATE, MessageBatch, read_layout
from idim_iv_ros.recording.bags.folder import Bag

_WORDS = ("reference", "ref", "command", "commands", "cmd", "desired", "target", "setpoint", "goal")


def robot_description(batch: MessageBatch) -> str | None:
    """Text of the last std_msgs/String of a batch, None if it is not one."""
    message = batch.message(len(batch) - 1)
    try:
        order = "<" if message[1] == 1 else ">"
        (size,) = struct.unpack_from(order + "I", message, 4)
        return message[8 : 8 + size].rstrip(b"\0").decode("utf-8")
    except (struct.error, IndexError, UnicodeDecodeError):
        return None


def prismatic_joints(urdf: str) -> frozenset[str]:
    """Joints that slide; none where the text is no URDF (whoever builds the model says so)."""
    try:
        root = ElementTree.fromstring(urdf)
    except (ElementTree.ParseError, ValueError):
        return frozenset()
    joints = root.iter("joint")
    return frozenset(e.get("name", "") for e in joints if e.get("type") == "prismatic")


def unused_references(bag: Bag, used: Sequence[str], joints: Sequence[str]) -> tuple[str, ...]:
    """Return the topics of a bag that hold positions of all joints, likely references first.

    Parameters
    ----------
    bag
        It was read before, so that its topics are known.
    used
        Topics that are used already.
    joints
        Names of the joints.
    """
    other = {name for name, kind in bag.topics.items() if kind == JOINT_STATE} - set(used)
    found: set[str] = set()
    waiting = set(other)
    for topic, batch in bag.unread().batches(other) if other else ():
        if topic in waiting and len(batch):
            waiting.discard(topic)
            if _holds(batch.message(0), joints):
                found.add(topic)
        if not waiting:
            break
    return tuple(sorted(found, key=lambda name: (not sounds_like_reference(name), name)))


def reference_advice(bag: Bag, used: Sequence[str], joints: Sequence[str]) -> str:
    """Say what to write where the reference is not on the topic that was named."""
    found = unused_references(bag, used, joints)
    if found:
        return f"; if the reference is on {found[0]}, write `reference: {found[0]}` under signals"
    return "; name that of the reference in signals.reference, or leave it out"


def _holds(message: bytes, joints: Sequence[str]) -> bool:
    try:
        layout = read_layout(message, JOINT_STATE)
    except DataError:
        return False
    _, positions = layout.fields["position"]
    return set(joints) <= set(layout.names) and positions == len(layout.names)


def sounds_like_reference(topic: str) -> bool:
    """Whether a word of a topic's name means a reference: ``/arm/joint_command``."""
    return any(word in _WORDS for word in re.split(r"[^a-z]+", topic.lower()))
