"""Which topics the recorder watches: those of the robot's configuration."""

from rclpy.node import Node

from idim_iv_ros.nodes.recorder.settings import RecorderSettings, signals
from idim_iv_ros.nodes.recorder.watched_topic import WatchedTopic
from idim_iv_ros.recording.bags.cdr import FLOAT_ARRAY, JOINT_STATE
from idim_iv_ros.recording.read import DESCRIPTION

_STRING = "std_msgs/msg/String"
_FEW = 10  # descriptions that wait


def recorder_topics(node: Node, settings: RecorderSettings) -> list[WatchedTopic]:
    """Return joint states, effort, reference and robot description, remapped as the node is.

    Raises
    ------
    UsageError
        The configuration cannot be read.
    """
    names, joints = signals(settings)
    needed: dict[str, list[str]] = {names.joint_states: ["position"]}
    needed.setdefault(names.effort or names.joint_states, []).append("effort")
    if names.reference is not None:
        needed.setdefault(names.reference, []).append("position")
    if not settings.configuration:
        needed[names.joint_states] = []
    topics = []
    for name, fields in needed.items():
        types = [JOINT_STATE, FLOAT_ARRAY] if fields == ["effort"] else [JOINT_STATE]
        resolved = node.resolve_topic_name(name)
        depth = settings.queue_depth
        topics.append(WatchedTopic(node, resolved, types, joints, sorted(set(fields)), depth))
    description = node.resolve_topic_name(DESCRIPTION)
    return [*topics, WatchedTopic(node, description, [_STRING], (), (), _FEW)]
