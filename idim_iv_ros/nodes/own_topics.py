"""Relative topics of a configuration as a node sees them."""

from pathlib import Path

from rclpy.node import Node

from idim_iv_ros.configuration import Configuration, load_configuration
from idim_iv_ros.errors import IdimError, UsageError
from idim_iv_ros.recording.topic_names import ROBOT_DESCRIPTION


def with_own_topics(node: Node, configuration: Configuration) -> Configuration:
    """Return the configuration for bags that a node asks for.

    Its relative topics are looked for first where the node would subscribe them itself: in its
    namespace, with its remappings.

    Raises
    ------
    UsageError
        A name is none that ROS allows.
    """
    own: dict[str, str] = {}
    for name in (*configuration.signals.relative_topics, ROBOT_DESCRIPTION):
        try:
            own[name] = node.resolve_topic_name(name)
        except Exception as error:  # rclpy has one class for each thing that can be wrong
            raise UsageError(
                f"{configuration.source}: signals: {name!r} is no topic of ROS: letters, digits "
                "and _, no digit first, parts separated by /"
            ) from error
    return configuration.with_own_topics(own)


def read_own(node: Node, file: str) -> Configuration:
    """Return the configuration of the parameter ``configuration``, as the node sees its topics.

    Raises
    ------
    UsageError
        It cannot be read, or names what is no topic; one line that names the parameter.
    """
    try:
        return with_own_topics(node, load_configuration(Path(file)))
    except IdimError as error:
        raise UsageError(f"configuration: {error}") from error
