"""Topics that hold references, recognised by their names."""

import re

_WORDS = ("reference", "ref", "command", "commands", "cmd", "desired", "target", "setpoint", "goal")


def sounds_like_reference(topic: str) -> bool:
    """Whether a word of a topic's name means a reference: ``/arm/joint_command``."""
    return any(word in _WORDS for word in re.split(r"[^a-z]+", topic.lower()))
