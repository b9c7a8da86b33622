"""Parameters of a node as one dataclass: what they mean, what is allowed, and their values."""

from collections.abc import Sequence
from dataclasses import Field, dataclass, field, fields
from typing import Any, TypeVar

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.node import Node
from rclpy.parameter import Parameter

from idim_iv_ros.errors import IdimError, UsageError

Value = TypeVar("Value", bool, int, float, str)


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


def declare(node: Node, kind: type[Kind]) -> Kind:
    """Declare all parameters on a node and return their values.

    Raises
    ------
    UsageError
        A value given at the start is not allowed.
    """
    for each in fields(kind):
        try:
            node.declare_parameter(each.name, each.default, _descriptor(each))
        except Exception as error:  # rclpy has one class for each thing that can be wrong
            reason = " ".join(str(error).split())
            raise UsageError(f"parameter {each.name}: {reason}") from error
    settings = kind(**{each.name: node.get_parameter(each.name).value for each in fields(kind)})
    try:
        settings.check()
    except IdimError as error:
        raise UsageError(f"parameter {error}") from error
    return settings


def changed(settings: Kind, parameters: Sequence[Parameter]) -> Kind:
    """Return the settings with new values.

    Raises
    ------
    UsageError
        A value is not allowed.
    """
    values = {each.name: getattr(settings, each.name) for each in fields(settings)}
    values.update({each.name: each.value for each in parameters if each.name in values})
    new = type(settings)(**values)
    new.check()
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
