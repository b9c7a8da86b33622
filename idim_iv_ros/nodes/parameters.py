"""A node's parameters as one dataclass: description, allowed values and present values."""

from ast import literal_eval
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import Field, dataclass, field, fields, replace
from difflib import get_close_matches
from itertools import pairwise
from pathlib import Path
from typing import Any, Generic, TypeVar

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.utilities import remove_ros_args

from idim_iv_ros.configuration import Configuration, load_configuration
from idim_iv_ros.configuration_file import read_mapping
from idim_iv_ros.errors import IdimError, UsageError
from idim_iv_ros.recording.request import ROBOT_DESCRIPTION

_NEEDED = {
    Parameter.Type.BOOL: "true or false",
    Parameter.Type.INTEGER: "a whole number",
    Parameter.Type.DOUBLE: "a number",
    Parameter.Type.STRING: "a text",
    Parameter.Type.STRING_ARRAY: "a list of texts",
}
_FILE = "--params-file"
_OPTIONS = ("--help", "--ros-args", "--param", _FILE, "--remap", "--log-level", "--enclave")
NAMES = "letters, digits and _, no digit first, parts separated by /"
_LIKENESS = 0.75  # of difflib, from which on one name is taken for another
_QOS = "qos_overrides."  # of the publishers and subscriptions of nodes that allow it
Value = TypeVar("Value", bool, int, float, str, tuple[str, ...])


@dataclass(frozen=True)
class Settings:
    """Base of dataclasses whose fields are made by `parameter`.

    A UsageError of `__post_init__` names a parameter that ranges and choices cannot check.
    """


Kind = TypeVar("Kind", bound=Settings)


def parameter(
    default: Value,
    about: str,
    span: tuple[float, float] | None = None,
    *,
    choices: tuple[str, ...] = (),
    read_only: bool = False,
) -> Value:
    """Return the dataclass field of one parameter.

    `about` describes it, with the unit; `span` is the smallest and largest value of a number;
    `choices` are the allowed texts (empty: any). `read_only` ones are set at the start only.
    """
    metadata = {"about": about, "span": span, "choices": choices, "read_only": read_only}
    declared: Value = field(default=default, metadata=metadata)
    return declared


class NodeProgram(Generic[Kind]):
    """A node with parameters of a dataclass `kind` that can be set while it runs.

    Raises UsageError: a value given at the start is not allowed, or a parameter is unknown.
    """

    def __init__(self, node: Node, kind: type[Kind], arguments: Sequence[str] = ()) -> None:
        self.node = node
        self._settings = declare(node, kind, arguments)

    def close(self) -> None:
        """Destroy the node; subclasses first end what is under way."""
        self.node.destroy_node()

    def _now(self) -> int:
        """Return the node's time, ns."""
        return int(self.node.get_clock().now().nanoseconds)

    def _follow_changes(self) -> None:
        self.node.add_on_set_parameters_callback(self._validate)
        self.node.add_post_set_parameters_callback(self._apply_changes)

    def _refuse(self, given: Mapping[str, Any]) -> str:
        """Return why parameters cannot be set now; empty if they can. For subclasses."""
        return ""

    def _apply(self, given: set[str]) -> None:
        """React to new `_settings`; `given` are names of the parameters set. For subclasses."""

    def _validate(self, parameters: list[Parameter]) -> SetParametersResult:
        given = {item.name: item.value for item in parameters}
        try:
            reason = self._refuse(given)
            if not reason:
                changed(self._settings, parameters)
            if not reason and given.get("configuration"):
                read_configuration(self.node, given["configuration"])
        except IdimError as error:
            reason = str(error).removeprefix("parameter ")
        return SetParametersResult(successful=not reason, reason=reason)

    def _apply_changes(self, parameters: list[Parameter]) -> None:
        self._settings = changed(self._settings, parameters)
        self._apply({item.name for item in parameters})


def declare(node: Node, kind: type[Kind], arguments: Sequence[str] = ()) -> Kind:
    """Declare all parameters of a dataclass on a node and return their values."""
    described = {item.name: item for item in fields(kind)}
    refuse_unknown_parameters(node, list(described), arguments)
    given = node._parameter_overrides
    try:
        for name, item in described.items():
            value = _checked_value(item, given[name]) if name in given else _default(item)
            node.declare_parameter(name, value, _descriptor(item), ignore_override=True)
        return kind(**{name: node.get_parameter(name).value for name in described})
    except IdimError as error:
        raise UsageError(f"parameter {error}") from error


def _default(described: "Field[Any]") -> Any:
    default = described.default  # a list is not empty: then it would have no type
    return list(default) if isinstance(default, tuple) else default


def _checked_value(described: "Field[Any]", given: Parameter) -> Any:
    """Return the value of a parameter as the type of its field; a UsageError if not allowed."""
    default, span = _default(described), described.metadata["span"]
    choices = described.metadata["choices"]
    needed, kind = Parameter.Type.from_parameter_value(default), given.type_
    value = given.value
    if isinstance(default, list) and value in (None, []):
        return default
    if needed == Parameter.Type.DOUBLE and kind == Parameter.Type.INTEGER:
        value, kind = float(value), needed  # 5 is meant as 5.0
    wrong = "" if kind == needed else f"of type {kind.name.lower()}"
    if not wrong and span is not None and not span[0] <= value <= span[1]:
        wrong = "out of range"
    if wrong:
        words = _NEEDED[needed] + (f" from {span[0]:.10g} to {span[1]:.10g}" if span else "")
        raise UsageError(f"{described.name}: {value!r} is {wrong}; {words} is needed")
    if choices and value not in choices:
        raise UsageError(f"{described.name}: {value!r} is neither {' nor '.join(choices)}")
    return value


def _descriptor(described: "Field[Any]") -> ParameterDescriptor:
    span, ranges = described.metadata["span"], {}
    if span is not None:
        real = isinstance(described.default, float)
        kind, number = (FloatingPointRange, float) if real else (IntegerRange, int)
        limits = kind(from_value=number(span[0]), to_value=number(span[1]))
        ranges["floating_point_range" if real else "integer_range"] = [limits]
    about, fixed = described.metadata["about"], described.metadata["read_only"]
    return ParameterDescriptor(name=described.name, description=about, read_only=fixed, **ranges)


def changed(settings: Kind, parameters: Sequence[Parameter]) -> Kind:
    """Return the settings with the values of `parameters`; unknown names are ignored."""
    described = {item.name: item for item in fields(settings)}
    given = {
        item.name: _checked_value(described[item.name], item)
        for item in parameters
        if item.name in described
    }
    try:
        return replace(settings, **given)
    except IdimError as error:
        prefix, text = ", ".join(given), str(error)
        raise UsageError(text if text.startswith(prefix) else f"{prefix}: {text}") from error


def read_configuration(node: Node, file: str) -> Configuration:
    """Return the configuration in a file, its topics resolved; a UsageError names the parameter."""
    try:
        return with_topics_of_node(node, load_configuration(Path(file)))
    except IdimError as error:
        raise UsageError(f"parameter configuration: {error}") from error


def with_topics_of_node(node: Node, configuration: Configuration) -> Configuration:
    """Return the configuration with its relative topics as the node resolves them.

    In a bag these names are looked for first. A UsageError says that one is not valid in ROS.
    """
    names: dict[str, str] = {}
    for name in (*configuration.signals.relative_topics, ROBOT_DESCRIPTION):
        try:
            names[name] = node.resolve_topic_name(name)
        except Exception as error:  # rclpy has one class for each thing that can be wrong
            where = f"{configuration.source}: signals: {name!r}"
            raise UsageError(f"{where} is no topic of ROS: {NAMES}") from error
    return configuration.with_node_topics(names)


def refuse_unknown_arguments(arguments: Sequence[str]) -> None:
    """Raise UsageError for arguments that ROS does not know; the first is the program's name."""
    try:
        others = remove_ros_args(list(arguments))[1:]
    except RuntimeError as error:
        if type(error).__name__ != "UnknownROSArgsError":  # rclpy does not export it
            raise
        others = literal_eval(str(error))
    if others:
        raise UsageError(
            f"unknown argument {with_nearest(others, _OPTIONS)}; a parameter is given by "
            "--ros-args -p NAME:=VALUE"
        )


def refuse_unknown_parameters(node: Node, names: Sequence[str], arguments: Sequence[str]) -> None:
    """Raise UsageError for parameters besides `names` that were given to this node alone.

    The log warns of those in files for nodes of any name (``/**``), which other nodes may need.
    """
    given = node._parameter_overrides  # of files and command line; rclpy has no public access
    unknown = [name for name in given if name not in names and not node.has_parameter(name)]
    if not unknown:
        return
    # In files for nodes of any name: in ``/**``, ``/left/*``.
    others = {
        name
        for option, file in pairwise(arguments)
        if option == _FILE
        for section, content in read_mapping(Path(file)).items()
        if section.endswith("*")
        for name in _dotted_names(content.get("ros__parameters", {}))
    }
    wrong = [name for name in unknown if name not in others and not name.startswith(_QOS)]
    if wrong:
        raise UsageError(f"unknown parameter {with_nearest(wrong, names)}")
    words = with_nearest(unknown, names)
    node.get_logger().warning(f"parameters that this node does not have: {words}")


def with_nearest(unknown: Sequence[str], names: Collection[str]) -> str:
    """Return unknown names as text, each followed by the most similar of `names`, if any."""
    words = []
    for name in unknown:
        nearest = get_close_matches(name, names, 1, _LIKENESS)
        words.append(f"{name} (did you mean {nearest[0]}?)" if nearest else name)
    return ", ".join(words)


def _dotted_names(parameters: Mapping[str, Any]) -> Iterator[str]:
    for key, value in parameters.items():
        if isinstance(value, Mapping):
            yield from (f"{key}.{name}" for name in _dotted_names(value))
        else:
            yield str(key)
