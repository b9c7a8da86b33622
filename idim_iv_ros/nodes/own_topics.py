"""Relative topics of a configuration as a node sees them."""

from rclpy.node import Node

from idim_iv_ros.configuration import Configuration
from idim_iv_ros.recording.topic_names import ROBOT_DESCRIPTION


def with_own_topics(node: Node, configuration: Configuration) -> Configuration:
    """Return the configuration for bags that a node asks for.

    Its relative topics are looked for first where the node would subscribe them itself: in its
    namespace, with its remappings.
    """
    names = (*configuration.signals.relative_topics, ROBOT_DESCRIPTION)
    return configuration.with_own_topics({name: node.resolve_topic_name(name) for name in names})
