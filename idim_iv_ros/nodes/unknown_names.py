"""Parameters and arguments that a node was given and does not have, with the nearest it has."""

from ast import literal_eval
from collections.abc import Collection, Sequence
from difflib import get_close_matches
from itertools import pairwise

from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.utilities import remove_ros_args

from idim_iv_ros.errors import UsageError

_FILE = "--params-file"
_OPTIONS = ("--help", "--ros-args", "--param", _FILE, "--remap", "--log-level", "--enclave")
_LIKENESS = 0.75  # of difflib, from which on one name is taken for another
_QOS = "qos_overrides."  # of the publishers and subscriptions of nodes that allow it


def refuse_unknown_arguments(arguments: Sequence[str]) -> None:
    """Refuse arguments that are neither the node's nor ROS's; the first is the program.

    Raises
    ------
    UsageError
        One line that names them.
    """
    try:
        others = remove_ros_args(list(arguments))[1:]
    except RuntimeError as error:
        if type(error).__name__ != "UnknownROSArgsError":  # rclpy does not export it
            raise
        others = literal_eval(str(error))
    if others:
        raise UsageError(
            f"unknown argument {named(others, _OPTIONS)}; a parameter is given by "
            "--ros-args -p NAME:=VALUE"
        )


def refuse_unknown_parameters(node: Node, names: Sequence[str], arguments: Sequence[str]) -> None:
    """Refuse parameters that only this node can be meant to have; warn of all others.

    What a file holds for nodes of any name (``/**``) may be meant for its neighbours.

    Parameters
    ----------
    node
    names
        Of the parameters that will be declared.
    arguments
        Command line of the node.

    Raises
    ------
    UsageError
        One line that names them.
    """
    given = node._parameter_overrides  # as rcl puts files and command line together
    unknown = [each for each in given if each not in names and not node.has_parameter(each)]
    if not unknown:
        return
    others = _for_any_node(node, arguments)
    wrong = [each for each in unknown if each not in others and not each.startswith(_QOS)]
    if wrong:
        raise UsageError(f"unknown parameter {named(wrong, names)}")
    node.get_logger().warning(f"parameters that this node does not have: {named(unknown, names)}")


def named(unknown: Sequence[str], names: Collection[str]) -> str:
    """Return unknown names, each with the nearest of `names` where there is one."""
    words = []
    for name in unknown:
        nearest = get_close_matches(name, names, 1, _LIKENESS)
        words.append(f"{name} (did you mean {nearest[0]}?)" if nearest else name)
    return ", ".join(words)


def _for_any_node(node: Node, arguments: Sequence[str]) -> set[str]:
    """Names of the parameters that a node of another name is given by the same files."""
    files = [each for pair in pairwise(arguments) if pair[0] == _FILE for each in pair]
    silent = Parameter("start_type_description_service", value=False)  # no policy allows it
    other = Node(
        "_of_no_name",
        context=node.context,
        namespace=node.get_namespace(),
        cli_args=["--ros-args", *files],
        use_global_arguments=False,
        enable_rosout=False,
        start_parameter_services=False,
        parameter_overrides=[silent],
    )
    try:
        return set(other._parameter_overrides)
    finally:
        other.destroy_node()
