"""Parameters of a node as one dataclass: what they mean, what is allowed, and their values."""

from collections.abc import Collection, Sequence
from dataclasses import Field, dataclass, field, fields
from pathlib import Path
from typing import Any, TypeVar

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.node import Node
from rclpy.parameter import Parameter

from idim_iv_ros.configuration import load_configuration
from idim_iv_ros.errors import IdimError, UsageError

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


def declare(node: Node, kind: type[Kind]) -> Kind:
    """Declare all parameters on a node and return their values.

    Raises
    ------
    UsageError
        A value given at the start is not allowed.
    """
    for each in fields(kind):
        try:
            if isinstance(each.default, float):
                node.declare_parameter(
                    each.name, _given_number(node, each), _descriptor(each), ignore_override=True
                )
            else:
                node.declare_parameter(each.name, _default(each), _descriptor(each))
        except Exception as error:  # rclpy has one class for each thing that can be wrong
            reason = " ".join(str(error).split())
            raise UsageError(f"parameter {each.name}: {reason}") from error
    settings = kind(**{each.name: node.get_parameter(each.name).value for each in fields(kind)})
    try:
        settings.check()
    except IdimError as error:
        raise UsageError(f"parameter {error}") from error
    doubles = {each.name for each in fields(kind) if isinstance(each.default, float)}
    node.add_pre_set_parameters_callback(
        lambda given: [_as_double(each, doubles) for each in given]
    )
    return settings


def _default(described: "Field[Any]") -> Any:
    if isinstance(described.default, tuple):
        return list(described.default)  # not empty: then it would have no type
    return described.default


def _given_number(node: Node, described: "Field[Any]") -> Any:
    """Value of a double that is given at the start; `5` is meant as 5.0."""
    anything = ParameterDescriptor(dynamic_typing=True)
    given = node.declare_parameter(described.name, described.default, anything)
    node.undeclare_parameter(described.name)
    return float(given.value) if given.type_ == Parameter.Type.INTEGER else given.value


def _as_double(given: Parameter, doubles: Collection[str]) -> Parameter:
    if given.name in doubles and given.type_ == Parameter.Type.INTEGER:
        return Parameter(given.name, Parameter.Type.DOUBLE, float(given.value))
    return given


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
