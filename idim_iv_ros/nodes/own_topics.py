"""Relative topics of a configuration as a node sees them."""

from collections.abc import Sequence
from pathlib import Path

from rcl_interfaces.msg import SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter

from idim_iv_ros.configuration import Configuration, load_configuration
from idim_iv_ros.errors import IdimError, UsageError
from idim_iv_ros.nodes.parameters import Settings, checked
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


def checked_topics(
    node: Node, settings: Settings, parameters: Sequence[Parameter]
) -> SetParametersResult:
    """Return whether the new values are allowed, and name topics of ROS where one is a file."""
    result = checked(settings, parameters)
    for each in parameters if result.successful else ():
        if each.name == "configuration" and each.value:
            try:
                read_own(node, each.value)
            except UsageError as error:
                return SetParametersResult(successful=False, reason=str(error))
    return result
