"""The URDF that a robot publishes on /robot_description."""

import struct

from idim_iv_ros.recording.message_batch import MessageBatch


def robot_description(batch: MessageBatch) -> str | None:
    """Text of the last std_msgs/String of a batch, None if it is not one."""
    message = batch.message(len(batch) - 1)
    try:
        order = "<" if message[1] == 1 else ">"
        (size,) = struct.unpack_from(order + "I", message, 4)
        return message[8 : 8 + size].rstrip(b"\0").decode("utf-8")
    except (struct.error, IndexError, UnicodeDecodeError):
        return None
