"""Messages of ros2_control's controllers, serialised by rosbags from the fields of control_msgs.

Fields and types: https://docs.ros.org/en/jazzy/p/control_msgs and …/en/humble/p/control_msgs.
"""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from rosbags.rosbag2 import StoragePlugin
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from tests.recording.bag_writer import header, write

STATE = "control_msgs/msg/JointTrajectoryControllerState"
DYNAMIC = "control_msgs/msg/DynamicJointState"
MANY = "control_msgs/msg/MultiDOFStateStamped"
LBR = "lbr_fri_idl/msg/LBRState"
ARM = "arm_msgs/msg/ArmState"

_HEAD = "std_msgs/Header header\nstring[] joint_names\n"
_POINT = "trajectory_msgs/JointTrajectoryPoint "
_FRAMES = "trajectory_msgs/MultiDOFJointTrajectoryPoint multi_dof_"


def _lines(prefix: str, names: str) -> str:
    return "".join(f"{prefix}{name}\n" for name in names.split())


_NEW, _OLD = "reference feedback error output", "desired actual error"
_BOTH = f"{_NEW} desired actual"
_MULTI = "string[] multi_dof_joint_names\n"
_DEFINITIONS = {
    "iron": _HEAD + _lines(_POINT, _NEW) + _MULTI + _lines(_FRAMES, _NEW),
    "humble": _HEAD + _lines(_POINT, _BOTH) + _MULTI + _lines(_FRAMES, _BOTH),
    "foxy": _HEAD + _lines(_POINT, _OLD),
}
_DEFINITIONS["jazzy"] = _DEFINITIONS["iron"] + "float64 speed_scaling_factor\n"
_OTHERS = {
    "control_msgs/msg/InterfaceValue": "string[] interface_names\nfloat64[] values\n",
    DYNAMIC: _HEAD + "control_msgs/InterfaceValue[] interface_values\n",
    "control_msgs/msg/SingleDOFState": "string name\nfloat64 reference\nfloat64 feedback\n"
    "float64 feedback_dot\nfloat64 error\nfloat64 error_dot\nfloat64 time_step\nfloat64 output\n",
    MANY: "std_msgs/Header header\ncontrol_msgs/SingleDOFState[] dof_states\n",
    LBR: "int8 session_state\nfloat64 sample_time\nfloat64[2] commanded_joint_position\n"
    "float64[2] measured_torque\nuint32 time_stamp_nano_sec\n",
    ARM: "std_msgs/Header header\nstring mode\nsensor_msgs/JointState desired_joint_state\n",
}


def store(version: str = "jazzy"):
    """Types of a distribution with those of control_msgs."""
    made = get_typestore(Stores.ROS2_JAZZY)
    types = get_types_from_msg(_DEFINITIONS[version], STATE)
    for name, text in _OTHERS.items():
        types.update(get_types_from_msg(text, name))
    made.register(types)
    return made


@dataclass
class ControlBag:
    """Writes topics of a controller manager into one bag."""

    version: str = "jazzy"
    messages: list = field(default_factory=list)

    def __post_init__(self) -> None:
        self.store = store(self.version)

    def header(self, stamp: float):
        return header(stamp, self.store.types)

    def point(self, stamp=0.0, position=(), velocity=(), acceleration=(), effort=()):
        """A point whose time from the start changes with every message, as it really does."""
        types = self.store.types
        since = types["builtin_interfaces/msg/Duration"](
            sec=int(stamp), nanosec=int(stamp % 1 * 1e9)
        )
        arrays = [
            np.array(numbers, dtype=float) for numbers in (position, velocity, acceleration, effort)
        ]
        return types["trajectory_msgs/msg/JointTrajectoryPoint"](*arrays, since)

    def frames(self):
        types = self.store.types
        none = types["builtin_interfaces/msg/Duration"](sec=0, nanosec=0)
        return types["trajectory_msgs/msg/MultiDOFJointTrajectoryPoint"]([], [], [], none)

    def state(
        self, stamp: float, joints, topic="/arm_controller/controller_state", **points
    ) -> None:
        """A controller_state; points that are not given are empty."""
        kind = self.store.types[STATE]
        values = {}
        for name in kind.__dataclass_fields__:
            if name == "__msgtype__":
                continue
            if name.startswith("multi_dof_"):
                values[name] = [] if name.endswith("names") else self.frames()
            else:
                values[name] = points.get(name, self.point(stamp))
        values.update(header=self.header(stamp), joint_names=list(joints))
        if "speed_scaling_factor" in values:
            values["speed_scaling_factor"] = 1.0
        self.add(topic, stamp, kind(**values))

    def dynamic(self, stamp: float, joints, interfaces, rows) -> None:
        """A dynamic_joint_states; `rows` holds one list of values for each joint."""
        types = self.store.types
        value = types["control_msgs/msg/InterfaceValue"]
        values = [
            value(list(names), np.array(row, dtype=float))
            for names, row in zip(interfaces, rows, strict=True)
        ]
        message = types[DYNAMIC](self.header(stamp), list(joints), values)
        self.add("/dynamic_joint_states", stamp, message)

    def joint_state(
        self, stamp: float, joints, position, velocity=(), effort=(), topic="/joint_states"
    ):
        kind = self.store.types["sensor_msgs/msg/JointState"]
        arrays = [np.array(numbers, dtype=float) for numbers in (position, velocity, effort)]
        message = kind(self.header(stamp), list(joints), *arrays)
        if topic:
            self.add(topic, stamp, message)
        return message

    def add(self, topic: str, stamp: float, message) -> None:
        self.messages.append((topic, stamp, message))

    def write(self, folder: Path, storage=StoragePlugin.MCAP, late: float = 5.0) -> Path:
        messages = sorted(self.messages, key=lambda message: message[1])
        arriving = [(topic, stamp + late, message) for topic, stamp, message in messages]
        return write(folder, arriving, storage, self.store)
