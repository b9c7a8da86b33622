"""Which numbers of a message are the positions, velocities and efforts of which joints.

Of ros2_control's own types that is known; of any other type the field is named by whoever reads.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from rosbags.interfaces import Nodetype
from rosbags.typesys.store import Typestore

from idim_iv_ros.errors import DataError, UsageError
from idim_iv_ros.recording.bags.definitions import (
    AND,
    CONTROLLER_STATE,
    DYNAMIC_STATE,
    FLOAT_ARRAY,
    JOINT_STATE,
    MANY_STATES,
    PLAIN,
    ROS2_CONTROL,
    SchemaText,
    versions,
)
from idim_iv_ros.types import FloatArray

QUANTITIES = ("position", "velocity", "effort")
# The same point under the names of newer and older versions of control_msgs.
_SAME = {"reference": "desired", "desired": "reference", "feedback": "actual", "actual": "feedback"}
_ASKED, _MEASURED, _OUTPUT = ("reference", "desired"), ("feedback", "actual"), ("output",)
POINTS = (*_ASKED, *_MEASURED, *_OUTPUT, "error")


class JointValues(NamedTuple):
    """What one message holds of joints.

    `stamp`: of its header, ns; zero where the type has none. `names`: of the joints; empty for an
    array without names. `numbers` (n,): of each quantity that is there, in the order of the names.
    `origins`: field of the message that each was read from.
    """

    stamp: int
    names: tuple[str, ...]
    numbers: dict[str, FloatArray]
    origins: dict[str, str]


_Quantities = tuple[Sequence[str], dict[str, tuple[str, Any]]]
"""Names of the joints; field and numbers by quantity."""


@dataclass(frozen=True)
class JointMessageType:
    """How messages of one topic are read.

    `name`: message type. `schema`: its definition as the bag holds it. `field`: which field of the
    message is meant; None: what suits. `reference`: whether it is what the controller was asked
    for, rather than what was measured.
    """

    name: str
    schema: SchemaText | None = None
    field: str | None = None
    reference: bool = False

    @property
    def numbered(self) -> bool:
        """Whether its numbers have no names: they are in the order of the joints."""
        return self.name == FLOAT_ARRAY or self.name not in (JOINT_STATE, *ROS2_CONTROL)

    def require_readable(self, bag: object, topic: str) -> None:
        """Refuse a type that holds no joint quantities, or whose field is not there.

        Raises DataError: one line that says what can be written instead.
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
            return _joint_state(content)
        if self.name == CONTROLLER_STATE:
            return self._controller_state(content)
        if self.name == DYNAMIC_STATE:
            return self._interfaces(content, quantities)
        if self.name == MANY_STATES:
            return self._many_states(content)
        return _named_field(content, "data" if self.field is None else self.field, quantities)

    def _controller_state(self, content: Any) -> _Quantities:
        points = _ASKED if self.reference else _MEASURED
        efforts = points if self.reference else (*_MEASURED, *_OUTPUT)
        if self.field is not None:
            points = efforts = (self.field, _SAME.get(self.field, self.field))
        fields = {}
        for quantity, member, allowed in (
            ("position", "positions", points),
            ("velocity", "velocities", points),
            ("effort", "effort", efforts),
        ):
            # Of a version with both names only one is filled.
            for point in allowed:
                numbers = getattr(getattr(content, point, None), member, ())
                if len(numbers):
                    fields[quantity] = (f"{point}.{member}", numbers)
                    break
        return content.joint_names, fields

    def _interfaces(self, content: Any, quantities: Sequence[str]) -> _Quantities:
        wanted = {name: name for name in QUANTITIES}
        if self.field is not None:
            wanted[_first_of(quantities)] = self.field
        joints = [
            dict(zip(joint.interface_names, joint.values, strict=False))
            for joint in content.interface_values
        ]
        return content.joint_names, {
            quantity: (name, np.array([joint.get(name, np.nan) for joint in joints]))
            for quantity, name in wanted.items()
            if any(name in joint for joint in joints)
        }

    def _many_states(self, content: Any) -> _Quantities:
        """Joint names, and numbers of all `dof_states`: their references, or their states."""
        of_reference = self.field == "reference" or (self.field is None and self.reference)
        members = {"position": "reference"} if of_reference else {
            "position": "feedback", "velocity": "feedback_dot", "effort": "output"
        }  # fmt: skip
        states = content.dof_states
        return [state.name for state in states], {
            quantity: (member, np.array([getattr(state, member) for state in states]))
            for quantity, member in members.items()
        }


def _joint_state(content: Any) -> _Quantities:
    return content.name, {name: (name, getattr(content, name)) for name in QUANTITIES}


def _named_field(content: Any, path: str, quantities: Sequence[str]) -> _Quantities:
    """Numbers of a field, or of a JointState in it."""
    value = content
    for name in path.split("."):
        value = getattr(value, name)
    if getattr(value, "__msgtype__", "") == JOINT_STATE:
        names, fields = _joint_state(value)
        return names, {name: (f"{path}.{name}", fields[name][1]) for name in QUANTITIES}
    numbers = np.atleast_1d(value)
    names = getattr(content, "joint_names", getattr(content, "name", ()))
    names = [names] if isinstance(names, str) else names
    named = len(numbers) == len(names)
    return names if named else (), {_first_of(quantities): (path, numbers)}


def _has_numbers(store: Typestore, kind: str, path: str) -> bool:
    """Whether a path from a type leads to numbers, or to a JointState."""
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


def _first_of(quantities: Sequence[str]) -> str:
    """What a named field holds: positions, where they are asked for at all."""
    return "position" if "position" in quantities else "effort"


def may_hold_joints(name: str) -> bool:
    """Whether a type holds joint quantities that are found without naming a field."""
    return name in PLAIN or name in ROS2_CONTROL
