"""Message types from the text that a bag holds of them, and the ones of ros2_control by name.

Bags by `ros2 bag record` hold the definition of every type since Iron (MCAP always). Without it a
type is read as one of the versions that its package had.
"""

from dataclasses import dataclass
from functools import lru_cache

from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

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
    """Definition of a type as a bag holds it: ``ros2msg`` or ``ros2idl``."""

    encoding: str
    text: str


def note_type(topics: dict[str, str], topic: str, kind: str) -> None:
    """Enter the type of a topic; of a topic with several all are named."""
    before = topics.get(topic) or kind
    topics[topic] = AND.join(dict.fromkeys((*before.split(AND), *filter(None, kind.split(AND)))))


@lru_cache(maxsize=64)
def versions(name: str, schema: SchemaText | None) -> tuple[Typestore, ...]:
    """Return the types with the version that a bag defines, else with each known one, newest first.

    May be empty.
    """
    if name in PLAIN:
        return (get_typestore(Stores.ROS2_JAZZY),)
    given = [schema] if schema is not None and schema.text.strip() else _VERSIONS.get(name, ())
    stores = (_with_definition(name, definition) for definition in given)
    return tuple(store for store in stores if store is not None)


def _with_definition(name: str, schema: SchemaText) -> Typestore | None:
    """Return the standard types and those of a definition; None where it is none of `name`."""
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
_TEXTS: dict[str, tuple[str, ...]] = {
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
_VERSIONS = {
    name: tuple(SchemaText("ros2msg", text) for text in texts) for name, texts in _TEXTS.items()
}
