"""Parameters of a node as one dataclass: what they mean, what is allowed, and their values."""

from collections.abc import Mapping, Sequence
from dataclasses import Field, dataclass, field, fields
from pathlib import Path
from typing import Any, TypeVar

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.exceptions import ParameterNotDeclaredException
from rclpy.node import Node
from rclpy.parameter import Parameter

from idim_iv_ros.configuration import load_configuration
from idim_iv_ros.errors import IdimError, UsageError
from idim_iv_ros.nodes.unknown_names import named, refuse_unknown_parameters

_NEEDED = {
    Parameter.Type.BOOL: "true or false",
    Parameter.Type.INTEGER: "a whole number",
    Parameter.Type.DOUBLE: "a number",
    Parameter.Type.STRING: "a text",
    Parameter.Type.STRING_ARRAY: "a list of texts",
}
Value = TypeVar("Value", bool, int, float, str, tuple[str, ...])


@dataclass(frozen=True)
class Settings:
    """Base of a node's parameters; every field of a child is made with `parameter`."""

    def check(self) -> None:
        """Check what a range cannot express.

        Raises
        ------
        UsageError
            One line that names the parameter.
        """
        self._check()

    def _check(self) -> None:
        """What a child checks."""

    def check_files(self) -> None:
        """Check what is read when the node is configured, where that is not at the start.

        Raises
        ------
        IdimError
            One line that names the file.
        """


Kind = TypeVar("Kind", bound=Settings)


def parameter(
    default: Value, about: str, span: tuple[float, float] | None = None, *, read_only: bool = False
) -> Value:
    """Return the field of one parameter.

    Parameters
    ----------
    default
    about
        Its meaning, with the unit.
    span
        Smallest and largest value of a number.
    read_only
        Whether it can be given at the start only.
    """
    metadata = {"about": about, "span": span, "read_only": read_only}
    made: Value = field(default=default, metadata=metadata)
    return made


def period_of_status(topics: str = "/diagnostics") -> float:
    """Return the field of the parameter ``status_period``."""
    about = f"time between two messages on {topics}, s"
    return parameter(1.0, about, (0.1, 60.0), read_only=True)


def declare(node: Node, kind: type[Kind], arguments: Sequence[str] = ()) -> Kind:
    """Declare all parameters on a node and return their values.

    Parameters
    ----------
    node
    kind
    arguments
        Command line of the node.

    Raises
    ------
    UsageError
        A value given at the start is not allowed, or is that of an unknown parameter.
    """
    described = {each.name: each for each in fields(kind)}
    refuse_unknown_parameters(node, list(described), arguments)
    given = node._parameter_overrides  # as rcl puts files and command line together
    try:
        for name, each in described.items():
            value = _accepted(each, given[name]) if name in given else _default(each)
            node.declare_parameter(name, value, _descriptor(each), ignore_override=True)
        settings = kind(**{name: node.get_parameter(name).value for name in described})
        settings.check()
    except IdimError as error:
        raise UsageError(f"parameter {error}") from error

    def accepted(parameters: list[Parameter]) -> list[Parameter]:
        try:
            return [_known(node, described, each) for each in parameters]
        except UsageError as error:
            raise _RefusedError(str(error)) from error

    node.add_pre_set_parameters_callback(accepted)
    return settings


class _RefusedError(ParameterNotDeclaredException):  # type: ignore[misc]
    """The one exception whose text rclpy sends to who asked for parameters to be set."""

    def __init__(self, reason: str) -> None:
        Exception.__init__(self, reason)


def _known(node: Node, described: "Mapping[str, Field[Any]]", given: Parameter) -> Parameter:
    if given.name in described:
        return Parameter(given.name, value=_accepted(described[given.name], given))
    if not node.has_parameter(given.name):
        raise UsageError(f"unknown parameter {named([given.name], described)}")
    return given


def _default(described: "Field[Any]") -> Any:
    if isinstance(described.default, tuple):
        return list(described.default)  # not empty: then it would have no type
    return described.default


def _accepted(described: "Field[Any]", given: Parameter) -> Any:
    """Value of a parameter that is given, in the type of its default."""
    default, span = _default(described), described.metadata["span"]
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
    return value


def changed(settings: Kind, parameters: Sequence[Parameter]) -> Kind:
    """Return the settings with new values; parameters of others change nothing.

    Raises
    ------
    UsageError
        A value is not allowed.
    """
    values = {each.name: getattr(settings, each.name) for each in fields(settings)}
    given = {each.name: each.value for each in parameters if each.name in values}
    if not given:
        return settings
    values.update(given)
    new = type(settings)(**values)
    try:
        new.check()
        new.check_files()
    except IdimError as error:
        names = ", ".join(given)
        text = str(error)
        raise UsageError(text if text.startswith(names) else f"{names}: {text}") from error
    return new


def checked(settings: Settings, parameters: Sequence[Parameter]) -> SetParametersResult:
    """Return whether the new values are allowed, and else why not, as rclpy asks for it."""
    try:
        changed(settings, parameters)
    except IdimError as error:
        return SetParametersResult(successful=False, reason=str(error))
    return SetParametersResult(successful=True)


def _descriptor(described: "Field[Any]") -> ParameterDescriptor:
    descriptor = ParameterDescriptor(
        name=described.name,
        description=described.metadata["about"],
        read_only=described.metadata["read_only"],
    )
    span = described.metadata["span"]
    if span is not None:
        low, high = span
        if isinstance(described.default, float):
            limits = FloatingPointRange(from_value=float(low), to_value=float(high))
            descriptor.floating_point_range = [limits]
        else:
            descriptor.integer_range = [IntegerRange(from_value=int(low), to_value=int(high))]
    return descriptor


def check_configuration(file: str) -> None:
    """Check the file of the parameter ``configuration``.

    Raises
    ------
    UsageError
        One line that names parameter and file.
    """
    try:
        load_configuration(Path(file))
    except IdimError as error:
        raise UsageError(f"configuration: {error}") from error
