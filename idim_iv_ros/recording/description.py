"""The URDF that a robot publishes on /robot_description."""

import struct
from xml.etree import ElementTree

from idim_iv_ros.recording.bags.message_batch import MessageBatch


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
