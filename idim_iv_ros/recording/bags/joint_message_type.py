"""Which numbers of a message are the positions, velocities and efforts of which joints.

Of ros2_control's own types that is known; of any other type the field is named by whoever reads.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from rosbags.interfaces import Nodetype

from idim_iv_ros.errors import DataError, UsageError
from idim_iv_ros.recording.bags.cdr import CdrLayout, Column, Located
from idim_iv_ros.recording.bags.definitions import (
    AND,
    CONTROLLER_STATE,
    DYNAMIC_STATE,
    FLOAT_ARRAY,
    JOINT_STATE,
    MANY_STATES,
    ROS2_CONTROL,
    MessageType,
    SchemaText,
    versions,
)

QUANTITIES = ("position", "velocity", "effort")
PLAIN = (JOINT_STATE, FLOAT_ARRAY)
# The same point under the names of newer and older versions of control_msgs.
_SAME = {"reference": "desired", "desired": "reference", "feedback": "actual", "actual": "feedback"}
_ASKED, _MEASURED, _OUTPUT = ("reference", "desired"), ("feedback", "actual"), ("output",)
POINTS = (*_ASKED, *_MEASURED, *_OUTPUT, "error")
_PADDING = 8  # bytes that may follow the last field

_Columns = tuple[tuple[str, ...], Mapping[str, Column | None]]
"""Names of the joints, and where their numbers lie by quantity."""


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
                there = self.field in ("position", "velocity", "effort", "data")
                words = (
                    f"{self.field} is read where it is needed"
                    if there
                    else (f"which has no field {self.field}")
                )
                raise UsageError(f"{bag}: {topic} is {self.name}, {words}: leave #{self.field} out")
            return
        kinds = versions(self.name, self.schema)
        if not kinds:
            raise DataError(
                f"{bag}: {topic} is {self.name}, which the bag does not define; "
                "sensor_msgs/msg/JointState is always read"
            )
        if self.name == DYNAMIC_STATE:
            return  # its fields are interfaces, which only messages name
        fields = [name for name, _ in kinds[0].fields[self.name]]
        if self.name in (CONTROLLER_STATE, MANY_STATES):
            points = POINTS if self.name == CONTROLLER_STATE else ("reference", "feedback")
            if self.field is not None and self.field not in points:
                there = self.field.partition(".")[0] in fields
                raise UsageError(
                    f"{bag}: {topic} is {self.name}, which has no {'point' if there else 'field'} "
                    f"{self.field}; it has {', '.join(name for name in fields if name in points)}"
                )
            return
        if self.field is None:
            raise DataError(
                f"{bag}: {topic} is {self.name}: say which of its fields holds the numbers of the "
                f"joints, as {topic}#FIELD ({', '.join(fields)})"
            )
        if not _has_numbers(kinds[0], self.field):
            raise UsageError(
                f"{bag}: {topic} is {self.name}, which has no numbers in {self.field}; its fields "
                f"are {', '.join(fields)}"
            )

    def layout(self, message: bytes, quantities: Sequence[str]) -> CdrLayout:
        """Read the layout of one message for some of position, velocity and effort.

        Raises DataError: the bytes are not a message of this type.
        """
        kinds = versions(self.name, self.schema)
        for kind in kinds:
            try:
                located = Located(message, kind)
                names, columns = self._columns(located, quantities)
            except (ValueError, KeyError):  # KeyError: a definition without its fields
                continue
            if len(kinds) == 1 or len(message) - located.end < _PADDING:
                return located.layout(names, columns)
        raise DataError(f"not a {self.name} message")

    def _columns(self, located: Located, quantities: Sequence[str]) -> _Columns:
        if self.name == JOINT_STATE:
            return located.texts["name"], {name: located.row(name) for name in QUANTITIES}
        if self.name == CONTROLLER_STATE:
            return self._controller_state(located)
        if self.name == DYNAMIC_STATE:
            return self._interfaces(located, quantities)
        if self.name == MANY_STATES:
            return self._many_states(located)
        field = "data" if self.name == FLOAT_ARRAY else self.field or ""
        return _named_field(located, field, quantities)

    def _controller_state(self, located: Located) -> _Columns:
        names = located.texts["joint_names"]
        points = _ASKED if self.reference else _MEASURED
        efforts = points if self.reference else (*_MEASURED, *_OUTPUT)
        if self.field is not None:
            points = efforts = (self.field, _SAME.get(self.field, self.field))
        columns = {}
        for quantity, member, allowed in (
            ("position", "positions", points),
            ("velocity", "velocities", points),
            ("effort", "effort", efforts),
        ):
            # Of a version with both names only one is filled.
            rows = (located.row(f"{point}.{member}", len(names)) for point in allowed)
            columns[quantity] = next(filter(None, rows), None)
        return names, columns

    def _interfaces(self, located: Located, quantities: Sequence[str]) -> _Columns:
        names = located.texts["joint_names"]
        wanted = {name: name for name in QUANTITIES}
        if self.field is not None:
            wanted[_first_of(quantities)] = self.field
        paths = [f"interface_values[{joint}]" for joint in range(len(names))]
        interfaces = [located.texts.get(f"{path}.interface_names", ()) for path in paths]
        return names, {
            quantity: located.column(
                wanted_name,
                [
                    (f"{path}.values", there.index(wanted_name) if wanted_name in there else -1)
                    for path, there in zip(paths, interfaces, strict=True)
                ],
            )
            for quantity, wanted_name in wanted.items()
        }

    def _many_states(self, located: Located) -> _Columns:
        """Joint names, and columns of all `dof_states`: of their references, or of their states."""
        paths = [f"dof_states[{k}]" for k in range(located.counts["dof_states"])]
        of_reference = self.field == "reference" or (self.field is None and self.reference)
        members = {"position": "reference"} if of_reference else {
            "position": "feedback", "velocity": "feedback_dot", "effort": "output"
        }  # fmt: skip
        return tuple(located.texts[f"{path}.name"][0] for path in paths), {
            quantity: located.column(member, [(f"{path}.{member}", 0) for path in paths])
            for quantity, member in members.items()
        }


def _named_field(located: Located, field: str, quantities: Sequence[str]) -> _Columns:
    """Columns of a field that holds numbers, or a JointState."""
    if f"{field}.name" in located.texts:
        names = located.texts[f"{field}.name"]
        return names, {name: located.row(f"{field}.{name}") for name in QUANTITIES}
    names = located.texts.get("joint_names", located.texts.get("name", ()))
    column = located.row(field)
    width = 0 if column is None else len(column.offsets)
    return names if width == len(names) else (), {_first_of(quantities): column}


def _has_numbers(kind: MessageType, path: str) -> bool:
    """Whether a path leads to numbers, or to a JointState."""
    described: Any = (Nodetype.NAME, kind.name)
    for name in path.split("."):
        node, detail = described
        fields = dict(kind.fields.get(detail, [])) if node == Nodetype.NAME else {}
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
