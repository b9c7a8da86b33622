"""ROS messages filled from objects by the names of their fields; messages on /diagnostics."""

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any, TypeVar

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node
from rclpy.time import Time
from std_msgs.msg import Header

from idim_iv_interfaces import msg

M = TypeVar("M")
OtherNames = Mapping[type, Callable[[Any], dict[str, object]]]

_PACKAGE = "idim_iv_interfaces/"


def message_of(
    kind: type[M], part: object, other_names: OtherNames = MappingProxyType({}), /, **given: object
) -> M:
    """Return a message of type `kind` with fields from the attributes of `part` and from `given`.

    Values in `given` take precedence. Numbers that are None become NaN, texts that are None empty;
    without a `part` all fields not given do. Times, also that of a header, are ns since 1970.
    `other_names` has, by type of message, a function from the object to the fields that differ from
    its attributes.
    """
    forms: Mapping[str, str] = kind.get_fields_and_field_types()  # type: ignore[attr-defined]
    if part is not None and kind in other_names:
        given = {**other_names[kind](part), **given}

    def value(form: str, given_value: Any) -> object:
        """Convert to the type of a field: ``double``, ``sequence<string>`` and so on."""
        if form.startswith("sequence<"):
            inner = form.removeprefix("sequence<").removesuffix(">")
            return [value(inner, item) for item in (() if given_value is None else given_value)]
        if form.startswith(_PACKAGE):
            inner_kind = getattr(msg, form.removeprefix(_PACKAGE))
            if isinstance(given_value, inner_kind):
                return given_value
            return message_of(inner_kind, given_value, other_names)
        if form in ("std_msgs/Header", "builtin_interfaces/Time"):
            stamp = Time(nanoseconds=given_value or 0).to_msg()
            return Header(stamp=stamp) if form == "std_msgs/Header" else stamp
        if form == "double":
            return float("nan") if given_value is None else float(given_value)
        if form == "string":
            return given_value or ""
        return given_value or 0 if form.startswith("uint") else bool(given_value)

    def content(name: str) -> Any:
        absent = part is None or name == "header"
        return given[name] if name in given else None if absent else getattr(part, name)

    return kind(**{name: value(form, content(name)) for name, form in forms.items()})


def diagnostic_status(
    level: bytes, name: str, hardware: str, sentence: str, values: Mapping[str, object]
) -> DiagnosticStatus:
    """Return an entry for /diagnostics; `values` are written as text."""
    pairs = [KeyValue(key=key, value=str(value)) for key, value in values.items()]
    return DiagnosticStatus(
        level=level, name=name, hardware_id=hardware, message=sentence, values=pairs
    )


class Diagnostics:
    """Publishes a node's status on /diagnostics."""

    def __init__(self, node: Node) -> None:
        self._clock = node.get_clock()
        self._publisher = node.create_publisher(DiagnosticArray, "/diagnostics", 10)

    def publish(self, *statuses: DiagnosticStatus) -> None:
        """Publish statuses, stamped with the present time."""
        message = DiagnosticArray(status=list(statuses))
        message.header.stamp = self._clock.now().to_msg()
        self._publisher.publish(message)
