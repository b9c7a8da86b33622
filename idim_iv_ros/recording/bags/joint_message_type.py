"""Which numbers of a message are the positions, velocities and efforts of which joints.

Of ros2_control's own types that is known; of any other type the field is named by whoever reads.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from rosbags.interfaces import Nodetype

from idim_iv_ros.errors import DataError, UsageError
from idim_iv_ros.recording.bags.cdr import (
    FLOAT_ARRAY,
    JOINT_STATE,
    ByteArray,
    CdrLayout,
    read_layout,
)
from idim_iv_ros.recording.bags.definitions import (
    AND,
    CONTROLLER_STATE,
    DYNAMIC_STATE,
    MANY_STATES,
    ROS2_CONTROL,
    MessageType,
    SchemaText,
    versions,
)
from idim_iv_ros.recording.bags.located import Located, Numbers, locate
from idim_iv_ros.types import FloatArray, IntArray

PLAIN = (JOINT_STATE, FLOAT_ARRAY)
# The same point under the names of newer and older versions of control_msgs.
_SAME = {"reference": "desired", "desired": "reference", "feedback": "actual", "actual": "feedback"}
_ASKED, _MEASURED, _OUTPUT = ("reference", "desired"), ("feedback", "actual"), ("output",)
POINTS = (*_ASKED, *_MEASURED, *_OUTPUT, "error")
_PADDING = 8  # bytes that may follow the last field

Places = dict[str, tuple[str, list[Numbers | None]]]
"""Of position, velocity and effort: the field it comes from, and one number for each joint."""


@dataclass(frozen=True)
class PlacedLayout(CdrLayout):
    """Layout of a message whose numbers lie anywhere.

    Attributes
    ----------
    places : dict
        Of each quantity the offset of every joint's number (-1: none), and its NumPy type.
    origins : dict
        Field of the message that each quantity comes from.
    """

    places: Mapping[str, tuple[IntArray, str]]
    origins: Mapping[str, str]

    def numbers(self, messages: ByteArray, field: str) -> FloatArray:
        """Numbers (k, n_joints) of a quantity of `messages` (k, size); NaN where there is none."""
        offsets, code = self.places[field]
        there = offsets >= 0
        size = int(code[-1])
        if there.all() and len(offsets) and np.all(np.diff(offsets) == size):
            raw = np.ascontiguousarray(messages[:, offsets[0] : offsets[-1] + size])
            return np.asarray(raw.view(code), dtype=np.float64)
        values = np.full((len(messages), len(offsets)), np.nan)
        bytes_ = offsets[there][:, None] + np.arange(size)
        raw = np.ascontiguousarray(messages[:, bytes_.reshape(-1)])
        values[:, there] = raw.view(code).reshape(len(messages), -1)
        return values


@dataclass(frozen=True)
class JointMessageType:
    """How messages of one topic are read.

    Attributes
    ----------
    name : str
        Message type.
    schema : SchemaText or None
        Its definition as the bag holds it.
    field : str or None
        Which field of the message is meant; None: what suits.
    reference : bool
        Whether it is what the controller was asked for, rather than what was measured.
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

        Raises
        ------
        DataError
            One line that says what can be written instead.
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
        if not _holds_numbers(kinds[0], self.field):
            raise UsageError(
                f"{bag}: {topic} is {self.name}, which has no numbers in {self.field}; its fields "
                f"are {', '.join(fields)}"
            )

    def layout(self, message: bytes, quantities: Sequence[str]) -> CdrLayout:
        """Read the layout of one message for some of position, velocity and effort.

        Raises
        ------
        DataError
            The bytes are not a message of this type.
        """
        if self.name in PLAIN:
            return read_layout(message, self.name)
        kinds = versions(self.name, self.schema)
        for kind in kinds:
            try:
                located = locate(message, kind)
            except ValueError:
                continue
            if len(kinds) == 1 or len(message) - located.end < _PADDING:
                return self._layout(message, located, kind, quantities)
        raise DataError(f"not a {self.name} message")

    def _layout(
        self, message: bytes, located: Located, kind: MessageType, quantities: Sequence[str]
    ) -> CdrLayout:
        if self.name == CONTROLLER_STATE:
            names, places = self._controller_state(located)
        elif self.name == DYNAMIC_STATE:
            names, places = self._interfaces(located, quantities)
        elif self.name == MANY_STATES:
            names, places = self._many_states(located)
        else:
            names, places = self._named_field(located, quantities)
        return _placed(message, located, names, places)

    def _controller_state(self, located: Located) -> tuple[tuple[str, ...], Places]:
        names = located.texts["joint_names"]
        points = _ASKED if self.reference else _MEASURED
        efforts = points if self.reference else (*_MEASURED, *_OUTPUT)
        if self.field is not None:
            points = efforts = (self.field, _SAME.get(self.field, self.field))
        places: Places = {}
        for quantity, member, allowed in (
            ("position", "positions", points),
            ("velocity", "velocities", points),
            ("effort", "effort", efforts),
        ):
            # Of a version with both names only one is filled.
            filled = (f"{point}.{member}" for point in allowed if _filled(located, point, member))
            path = next(filled, "")
            places[quantity] = (path, _row(located.numbers.get(path), len(names)))
        return names, places

    def _interfaces(
        self, located: Located, quantities: Sequence[str]
    ) -> tuple[tuple[str, ...], Places]:
        names = located.texts["joint_names"]
        wanted = {name: name for name in ("position", "velocity", "effort")}
        if self.field is not None:
            wanted[_first_of(quantities)] = self.field
        places: Places = {name: (interface, []) for name, interface in wanted.items()}
        for joint in range(len(names)):
            path = f"interface_values[{joint}]"
            interfaces = located.texts.get(f"{path}.interface_names", ())
            row = _row(located.numbers.get(f"{path}.values"), len(interfaces))
            for interface, column in places.values():
                present = interface in interfaces
                column.append(row[interfaces.index(interface)] if present else None)
        return names, places

    def _many_states(self, located: Located) -> tuple[tuple[str, ...], Places]:
        count = located.counts.get("dof_states", 0)
        names = tuple(located.texts[f"dof_states[{k}].name"][0] for k in range(count))
        asked = self.field == "reference" or (self.field is None and self.reference)
        members = {"position": "reference"} if asked else {
            "position": "feedback", "velocity": "feedback_dot", "effort": "output"
        }  # fmt: skip
        return names, {
            quantity: (member, [located.numbers[f"dof_states[{k}].{member}"] for k in range(count)])
            for quantity, member in members.items()
        }

    def _named_field(
        self, located: Located, quantities: Sequence[str]
    ) -> tuple[tuple[str, ...], Places]:
        field = self.field or ""
        if f"{field}.name" in located.texts:  # a JointState within the message
            names = located.texts[f"{field}.name"]
            paths = {name: f"{field}.{name}" for name in ("position", "velocity", "effort")}
        else:
            names = located.texts.get("joint_names", located.texts.get("name", ()))
            paths = {_first_of(quantities): field}
        numbers = {name: located.numbers.get(path) for name, path in paths.items()}
        counts = {row.count for row in numbers.values() if row is not None}
        if counts != {len(names)} and f"{field}.name" not in located.texts:
            names = ()
        width = max(max(counts), len(names))
        return names, {name: (paths[name], _row(row, width)) for name, row in numbers.items()}


def _holds_numbers(kind: MessageType, path: str) -> bool:
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


def _filled(located: Located, point: str, member: str) -> bool:
    numbers = located.numbers.get(f"{point}.{member}")
    return numbers is not None and numbers.count > 0


def _first_of(quantities: Sequence[str]) -> str:
    """What a named field holds: positions, where they are asked for at all."""
    return "position" if "position" in quantities else "effort"


def _row(numbers: Numbers | None, count: int) -> list[Numbers | None]:
    """Split a row into single numbers, one for each of `count` joints; None where it ends."""
    if numbers is None:
        return [None] * count
    size = int(numbers.code[-1])
    row = [
        Numbers(numbers.offset + k * size, 1, numbers.code)
        for k in range(min(numbers.count, count))
    ]
    return [*row, *[None] * (count - len(row))]


def _placed(
    message: bytes, located: Located, names: tuple[str, ...], places: Places
) -> PlacedLayout:
    placed, fields = {}, {}
    for quantity, (_, row) in places.items():
        codes = {number.code for number in row if number is not None}
        if len(codes) != 1:
            fields[quantity] = (0, 0)
            continue
        offsets = np.array(
            [-1 if number is None else number.offset for number in row], dtype=np.int64
        )
        placed[quantity], fields[quantity] = (offsets, codes.pop()), (0, len(row))
    return PlacedLayout(
        size=len(message),
        order=located.order,
        stamp=located.stamp,
        names=names,
        fields=fields,
        fixed=np.frombuffer(message, dtype=np.uint8),
        structure=located.places,
        places=placed,
        origins={quantity: path for quantity, (path, _) in places.items() if quantity in placed},
    )


def may_hold_joints(name: str) -> bool:
    """Whether a type holds joint quantities that are found without naming a field."""
    return name in PLAIN or name in ROS2_CONTROL
