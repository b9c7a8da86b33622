"""What a bag holds besides measurements: the robot's description, and perhaps its reference."""

import re
import struct
from collections.abc import Sequence
from xml.etree import ElementTree

import numpy as np

from idim_iv_ros.recording.bags.cdr import MessageBatch
from idim_iv_ros.recording.bags.definitions import CONTROLLER_STATE, JOINT_STATE
from idim_iv_ros.recording.bags.folder import Bag
from idim_iv_ros.recording.bags.joint_message_type import JointMessageType
from idim_iv_ros.recording.bags.joint_messages import JointMessageReader
from idim_iv_ros.signal_source import topic_of

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

    The bag was read before, so that its topics are known; `used` are sources that are used already.
    """
    measured = set(map(topic_of, used))
    # What a controller was asked for is a reference, also of the topic that gives what it measured.
    kinds = {
        name: JointMessageType(kind, bag.definitions.get(kind), reference=True)
        for name, kind in bag.topics.items()
        if kind == CONTROLLER_STATE or (kind == JOINT_STATE and name not in measured)
    }
    references: set[str] = set()
    waiting = set(kinds)
    for topic, batch in bag.unread().batches(set(kinds)) if kinds else ():
        if topic in waiting and len(batch):
            reader = JointMessageReader(topic, kinds[topic], joints, ["position"])
            reader.add(batch)
            if np.isfinite(reader.finish().values["position"]).any(axis=0).all():
                references.add(topic)
                waiting.discard(topic)
            elif kinds[topic].name == JOINT_STATE:  # a controller may not be active yet
                waiting.discard(topic)
        if not waiting:
            break

    def likely(topic: str) -> tuple[bool, bool, str]:
        of_controller = kinds[topic].name == CONTROLLER_STATE
        return not of_controller, not sounds_like_reference(topic), topic

    return tuple(sorted(references, key=likely))


def reference_advice(bag: Bag, used: Sequence[str], joints: Sequence[str]) -> str:
    """Say what to write where the reference is not on the topic that was named."""
    references = unused_references(bag, used, joints)
    if references:
        first = references[0]
        return f"; if the reference is on {first}, write `reference: {first}` under signals"
    return "; name that of the reference in signals.reference, or leave it out"


def sounds_like_reference(topic: str) -> bool:
    """Whether a word of a topic's name means a reference: ``/arm/joint_command``."""
    return any(word in _WORDS for word in re.split(r"[^a-z]+", topic.lower()))
