"""Decoding of joint messages: which numbers are positions, velocities and efforts of which joints.

That is known of the types of ros2_control; for any other type the user names the field. Bags by
`ros2 bag record` hold the definition of every type since Iron (MCAP always). Without it, a message
is read by one of the published versions of its type.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, NamedTuple

import numpy as np
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from idim_iv_ros.errors import DataError, UsageError
from idim_iv_ros.types import FloatArray

JOINT_STATE = "sensor_msgs/msg/JointState"
FLOAT_ARRAY = "std_msgs/msg/Float64MultiArray"
CONTROLLER_STATE = "control_msgs/msg/JointTrajectoryControllerState"
MANY_STATES = "control_msgs/msg/MultiDOFStateStamped"
DYNAMIC_STATE = "control_msgs/msg/DynamicJointState"
ROS2_CONTROL = (CONTROLLER_STATE, MANY_STATES, DYNAMIC_STATE)
PLAIN = (JOINT_STATE, FLOAT_ARRAY)

AND = " and "  # between the types of one topic
_LONGEST = 200_000  # characters of a definition; the largest of ROS have 30,000


@dataclass(frozen=True)
class SchemaText:
    """Definition of a message type as a bag holds it; `encoding` is ``ros2msg`` or ``ros2idl``."""

    encoding: str
    text: str


def note_type(topics: dict[str, str], topic: str, kind: str) -> None:
    """Enter the type of a topic; several types of one topic are joined by ``and``."""
    before = topics.get(topic) or kind
    topics[topic] = AND.join(dict.fromkeys((*before.split(AND), *filter(None, kind.split(AND)))))


@lru_cache(maxsize=64)
def versions(name: str, schema: SchemaText | None) -> tuple[Typestore, ...]:
    """Return type stores with `name` as the bag defines it, else as published, newest first.

    Empty if the type has no known definition.
    """
    if name in PLAIN:
        return (get_typestore(Stores.ROS2_JAZZY),)
    published = (SchemaText("ros2msg", text) for text in _PUBLISHED.get(name, ()))
    given = [schema] if schema is not None and schema.text.strip() else published
    stores = (_with_definition(name, definition) for definition in given)
    return tuple(store for store in stores if store is not None)


def _with_definition(name: str, schema: SchemaText) -> Typestore | None:
    """Return the standard types with those of a definition; None if it does not define `name`."""
    if len(schema.text) > _LONGEST:
        return None
    store = get_typestore(Stores.ROS2_JAZZY)
    try:
        types = (
            get_types_from_idl(schema.text)
            if schema.encoding == "ros2idl"
            else get_types_from_msg(schema.text, name)
        )
        for defined in types:
            store.fielddefs.pop(defined, None)
        store.register(types)
    except Exception:  # text of a stranger: whatever the parser stumbles over, it is no definition
        return None
    return store if name in types else None


def _controller_state(points: str, last: str = "", *, frames: bool = True) -> str:
    """Return a definition of a controller state with these points, of joints and of frames."""
    lines = ["std_msgs/Header header", "string[] joint_names"]
    lines += [f"trajectory_msgs/JointTrajectoryPoint {point}" for point in points.split()]
    if frames:
        kind = "trajectory_msgs/MultiDOFJointTrajectoryPoint"
        lines += ["string[] multi_dof_joint_names"]
        lines += [f"{kind} multi_dof_{point}" for point in points.split()]
    return "\n".join([*lines, last])


# Newest first. https://docs.ros.org/en/jazzy/p/control_msgs, …/en/humble/…; the last is Foxy's.
_PUBLISHED: dict[str, tuple[str, ...]] = {
    CONTROLLER_STATE: (
        _controller_state("reference feedback error output", "float64 speed_scaling_factor"),
        _controller_state("reference feedback error output"),
        _controller_state("reference feedback error output desired actual"),
        _controller_state("desired actual error", frames=False),
    ),
    DYNAMIC_STATE: (
        "std_msgs/Header header\nstring[] joint_names\ncontrol_msgs/InterfaceValue[] "
        f"interface_values\n{'=' * 80}\nMSG: control_msgs/InterfaceValue\n"
        "string[] interface_names\nfloat64[] values",
    ),
    MANY_STATES: (
        "std_msgs/Header header\ncontrol_msgs/SingleDOFState[] dof_states\n"
        f"{'=' * 80}\nMSG: control_msgs/SingleDOFState\n"
        "string name\nfloat64 reference\nfloat64 feedback\nfloat64 feedback_dot\nfloat64 error\n"
        "float64 error_dot\nfloat64 time_step\nfloat64 output",
    ),
}

QUANTITIES = ("position", "velocity", "effort")
# Names of one point in newer and older versions of control_msgs.
_SAME = {"reference": "desired", "desired": "reference", "feedback": "actual", "actual": "feedback"}
_MEMBERS = {"position": "positions", "velocity": "velocities", "effort": "effort"}
_ASKED, _MEASURED, _OUTPUT = ("reference", "desired"), ("feedback", "actual"), ("output",)
POINTS = (*_ASKED, *_MEASURED, *_OUTPUT, "error")


class JointValues(NamedTuple):
    """Joint quantities in one message."""

    stamp: int  # of the header, ns; zero without
    names: tuple[str, ...]  # of joints; empty for an array without names
    numbers: dict[str, FloatArray]  # (n,) by quantity, ordered as the names
    origins: dict[str, str]  # fields of the numbers


_Quantities = tuple[Sequence[str], dict[str, tuple[str, Any]]]
"""Names of the joints; field and numbers by quantity."""


@dataclass(frozen=True)
class JointMessageType:
    """How messages of one topic are decoded."""

    name: str  # of the message type
    schema: SchemaText | None = None  # its definition in the bag
    field: str | None = None  # the field to read; None for the usual one
    reference: bool = False  # whether to read references, not measurements

    def require_readable(self, bag: object, topic: str) -> None:
        """Check that the type holds joint quantities, and the named field.

        Raises DataError or UsageError: one line that says what can be written instead.
        """
        if AND in self.name:
            raise DataError(
                f"{bag}: messages of several types are on {topic}: {self.name}; record each under "
                "a name of its own"
            )
        if self.name in PLAIN:
            if self.field is not None and self.field not in POINTS:
                raise UsageError(f"{bag}: {topic} is {self.name}: leave #{self.field} out")
            return
        if not self._stores:
            raise DataError(
                f"{bag}: {topic} is {self.name}, which the bag does not define; "
                "sensor_msgs/msg/JointState is always read"
            )
        if self.name == DYNAMIC_STATE:
            return  # its fields are interfaces, which only messages name
        fields = [name for name, _ in self._stores[0].fielddefs[self.name][1]]
        if self.name in (CONTROLLER_STATE, MANY_STATES):
            points = POINTS if self.name == CONTROLLER_STATE else ("reference", "feedback")
            if self.field is not None and self.field not in points:
                raise UsageError(
                    f"{bag}: {topic} is {self.name}: #{self.field} is none of "
                    f"{', '.join(name for name in fields if name in points)}"
                )
            return
        if self.field is None:
            raise DataError(
                f"{bag}: {topic} is {self.name}: say which of its fields holds the numbers of the "
                f"joints, as {topic}#FIELD ({', '.join(fields)})"
            )
        if not _has_numbers(self._stores[0], self.name, self.field):
            raise UsageError(
                f"{bag}: {topic} is {self.name}, which has no numbers in {self.field}; its fields "
                f"are {', '.join(fields)}"
            )

    @cached_property
    def _stores(self) -> tuple[Typestore, ...]:
        return versions(self.name, self.schema)

    def read(self, message: bytes, quantities: Sequence[str]) -> JointValues:
        """Read some of position, velocity and effort of one message.

        Raises DataError: the bytes are not a message of this type.
        """
        for store in self._stores:
            try:
                content: Any = store.deserialize_cdr(memoryview(message), self.name)
                names, fields = self._fields(content, quantities)
            except Exception:  # what rosbags raises of a stranger's bytes has no common class
                continue
            stamp = getattr(getattr(content, "header", content), "stamp", None)
            nanoseconds = 0 if stamp is None else stamp.sec * 1_000_000_000 + stamp.nanosec
            numbers, origins = {}, {}
            for quantity in quantities:
                origin, values = fields.get(quantity, ("", ()))
                if len(values):
                    numbers[quantity], origins[quantity] = values, origin
            return JointValues(nanoseconds, tuple(names), numbers, origins)
        raise DataError(f"not a {self.name} message")

    def _fields(self, content: Any, quantities: Sequence[str]) -> _Quantities:
        if self.name == JOINT_STATE:
            return content.name, {name: (name, getattr(content, name)) for name in QUANTITIES}
        if self.name == CONTROLLER_STATE:
            return self._controller_state(content)
        if self.name == DYNAMIC_STATE:
            return self._interfaces(content, quantities)
        if self.name == MANY_STATES:
            return self._states_of_dofs(content)
        return _named_field(content, "data" if self.field is None else self.field, quantities)

    def _controller_state(self, content: Any) -> _Quantities:
        points = _ASKED if self.reference else _MEASURED
        efforts = points if self.reference else (*_MEASURED, *_OUTPUT)
        if self.field is not None:
            points = efforts = (self.field, _SAME.get(self.field, self.field))
        fields: dict[str, tuple[str, Any]] = {}
        # Versions with both names fill one of them.
        for point in efforts:
            for quantity, member in _MEMBERS.items() if point in points else [("effort", "effort")]:
                numbers = getattr(getattr(content, point, None), member, ())
                if len(numbers):
                    fields.setdefault(quantity, (f"{point}.{member}", numbers))
        return content.joint_names, fields

    def _interfaces(self, content: Any, quantities: Sequence[str]) -> _Quantities:
        """Return joint names and numbers of a DynamicJointState, by interface."""
        wanted = {name: name for name in QUANTITIES}
        if self.field is not None:
            wanted[_field_quantity(quantities)] = self.field
        joints = [
            dict(zip(joint.interface_names, joint.values, strict=False))
            for joint in content.interface_values
        ]
        return content.joint_names, {
            quantity: (name, np.array([joint.get(name, np.nan) for joint in joints]))
            for quantity, name in wanted.items()
            if any(name in joint for joint in joints)
        }

    def _states_of_dofs(self, content: Any) -> _Quantities:
        """Return joint names and numbers of `dof_states`: references or measurements."""
        of_reference = self.field == "reference" or (self.field is None and self.reference)
        members = {"position": "reference"} if of_reference else {
            "position": "feedback", "velocity": "feedback_dot", "effort": "output"
        }  # fmt: skip
        states = content.dof_states
        return [state.name for state in states], {
            quantity: (member, np.array([getattr(state, member) for state in states]))
            for quantity, member in members.items()
        }


def _named_field(content: Any, path: str, quantities: Sequence[str]) -> _Quantities:
    """Return joint names and numbers of a field, or of a JointState in it."""
    value = content
    for name in path.split("."):
        value = getattr(value, name)
    if getattr(value, "__msgtype__", "") == JOINT_STATE:
        return value.name, {name: (f"{path}.{name}", getattr(value, name)) for name in QUANTITIES}
    numbers = np.atleast_1d(value)
    names = getattr(content, "joint_names", getattr(content, "name", ()))
    names = [names] if isinstance(names, str) else names
    named = len(numbers) == len(names)
    return names if named else (), {_field_quantity(quantities): (path, numbers)}


def _has_numbers(store: Typestore, kind: str, path: str) -> bool:
    """Return whether a path of fields leads from a type to numbers, or to a JointState."""
    described: Any = (Nodetype.NAME, kind)
    for name in path.split("."):
        node, detail = described
        fields = dict(store.fielddefs[detail][1]) if node == Nodetype.NAME else {}
        if name not in fields:
            return False
        described = fields[name]
    node, detail = described
    if node == Nodetype.NAME:
        return bool(detail == JOINT_STATE)
    if node in (Nodetype.ARRAY, Nodetype.SEQUENCE):
        node, detail = detail[0]
    return bool(node == Nodetype.BASE and detail[0] != "string")


def _field_quantity(quantities: Sequence[str]) -> str:
    """Return the quantity that a named field holds: position if requested, else effort."""
    return "position" if "position" in quantities else "effort"


def may_hold_joints(name: str) -> bool:
    """Return whether joint quantities can be read from a type without naming a field."""
    return name in PLAIN or name in ROS2_CONTROL
