"""Message types from the text that a bag holds of them, and the ones of ros2_control by name.

Bags by `ros2 bag record` hold the definition of every type since Iron (MCAP always). Without it a
type is read as one of the versions that its package had.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache, lru_cache
from typing import Any

from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore

JOINT_STATE = "sensor_msgs/msg/JointState"
FLOAT_ARRAY = "std_msgs/msg/Float64MultiArray"
CONTROLLER_STATE = "control_msgs/msg/JointTrajectoryControllerState"
MANY_STATES = "control_msgs/msg/MultiDOFStateStamped"
DYNAMIC_STATE = "control_msgs/msg/DynamicJointState"
ROS2_CONTROL = (CONTROLLER_STATE, MANY_STATES, DYNAMIC_STATE)

AND = " and "  # between the types of one topic
_LONGEST = 200_000  # characters of a definition; the largest of ROS have 30,000

Fields = list[tuple[str, tuple[Any, Any]]]
"""Name and type of each field, as rosbags describes it."""


@dataclass(frozen=True)
class SchemaText:
    """Definition of a type as a bag holds it: ``ros2msg`` or ``ros2idl``."""

    encoding: str
    text: str


@dataclass(frozen=True)
class MessageType:
    """One version of a type: its fields and those of the types that it consists of, by name."""

    name: str
    fields: Mapping[str, Fields]


def note_type(topics: dict[str, str], topic: str, kind: str) -> None:
    """Enter the type of a topic; of a topic with several all are named."""
    before = topics.get(topic) or kind
    topics[topic] = AND.join(dict.fromkeys((*before.split(AND), *filter(None, kind.split(AND)))))


@lru_cache(maxsize=64)
def versions(name: str, schema: SchemaText | None) -> tuple[MessageType, ...]:
    """Return the version of a type that a bag defines, else all that are known; may be empty."""
    if name in _PLAIN:
        return (MessageType(name, _PLAIN),)
    if schema is not None and schema.text.strip():
        return _parsed(name, schema)
    texts = _VERSIONS.get(name, ())
    return tuple(kind for text in texts for kind in _parsed(name, SchemaText("ros2msg", text)))


def _parsed(name: str, schema: SchemaText) -> tuple[MessageType, ...]:
    if len(schema.text) > _LONGEST:
        return ()
    try:
        types = (
            get_types_from_idl(schema.text)
            if schema.encoding == "ros2idl"
            else get_types_from_msg(schema.text, name)
        )
    except Exception:  # text of a stranger: whatever the parser stumbles over, it is no definition
        return ()
    fields = {**_standard(), **{kind: list(parts[1]) for kind, parts in types.items()}}
    return (MessageType(name, fields),) if name in types else ()


@cache
def _standard() -> dict[str, Fields]:
    """Types that every installation has, for definitions without those they consist of."""
    store = get_typestore(Stores.ROS2_JAZZY)
    return {name: list(parts[1]) for name, parts in store.fielddefs.items()}


# Written out, because the whole store of ROS 2's types takes a tenth of a second to load.
_TEXT, _NUMBER = (Nodetype.BASE, ("string", 0)), (Nodetype.BASE, ("uint32", 0))
_NUMBERS = (Nodetype.SEQUENCE, ((Nodetype.BASE, ("float64", 0)), 0))
_PLAIN: dict[str, Fields] = {
    JOINT_STATE: [
        ("stamp.sec", _NUMBER),
        ("stamp.nanosec", _NUMBER),
        ("frame_id", _TEXT),
        ("name", (Nodetype.SEQUENCE, (_TEXT, 0))),
        *((name, _NUMBERS) for name in ("position", "velocity", "effort")),
    ],
    FLOAT_ARRAY: [
        ("dim", (Nodetype.SEQUENCE, ((Nodetype.NAME, "dimension"), 0))),
        ("data_offset", _NUMBER),
        ("data", _NUMBERS),
    ],
    "dimension": [("label", _TEXT), ("size", _NUMBER), ("stride", _NUMBER)],
}

_POINT, _MANY = (
    "trajectory_msgs/JointTrajectoryPoint",
    "trajectory_msgs/MultiDOFJointTrajectoryPoint",
)


def _controller_state(points: str, last: str = "") -> str:
    """Definition with these points, once of joints and, under ``multi_dof_``, once of frames."""
    lines = ["std_msgs/Header header", "string[] joint_names"]
    lines += [f"{_POINT} {point}" for point in points.split()]
    lines += ["string[] multi_dof_joint_names"]
    lines += [f"{_MANY} multi_dof_{point}" for point in points.split()]
    return "\n".join([*lines, last])


# Newest first. https://docs.ros.org/en/jazzy/p/control_msgs, …/en/humble/…; the last is Foxy's.
_VERSIONS: dict[str, tuple[str, ...]] = {
    CONTROLLER_STATE: (
        _controller_state("reference feedback error output", "float64 speed_scaling_factor"),
        _controller_state("reference feedback error output"),
        _controller_state("reference feedback error output desired actual"),
        "\n".join(
            ["std_msgs/Header header", "string[] joint_names"]
            + [f"{_POINT} {point}" for point in ("desired", "actual", "error")]
        ),
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
