"""Parameters of the recorder: what they mean, what is allowed, and their values as one object."""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.node import Node
from rclpy.parameter import Parameter

from idim_iv_ros.configuration import SignalsSection, load_configuration
from idim_iv_ros.errors import IdimError, UsageError

_LARGEST = 1 << 62


@dataclass(frozen=True)
class RecorderSettings:
    """Values of the parameters; the names are the same."""

    configuration: str = ""
    bag_directory: str = "."
    bag_prefix: str = "recording"
    autostart: bool = False
    chunk_duration: float = 1.0
    max_file_size: int = 0
    max_file_duration: float = 0.0
    minimum_free_disk: int = 200_000_000
    memory_limit: int = 500_000_000
    max_message_size: int = 64_000_000
    queue_depth: int = 20_000
    late_after: float = 0.1
    gap_factor: float = 5.0
    status_period: float = 1.0

    def check(self) -> None:
        """Check what a range cannot express.

        Raises
        ------
        UsageError
            One line that names the parameter.
        """
        if not self.bag_prefix or self.bag_prefix != Path(self.bag_prefix).name:
            raise UsageError(f"bag_prefix: {self.bag_prefix!r} is not the name of a folder")
        if self.configuration:
            load_configuration(Path(self.configuration))


_READ_ONLY = ("autostart", "queue_depth", "status_period")
_TEXT = {
    "configuration": "the robot's YAML file, whose topics are recorded; empty: /joint_states and "
    "/robot_description",
    "bag_directory": "folder in which the bags are made",
    "bag_prefix": "bags are named PREFIX_YYYY_MM_DD-HH_MM_SS",
    "autostart": "start recording at once",
    "chunk_duration": "what a crash can lose at most, s",
    "max_file_size": "a new file begins when one has so many bytes; 0: never",
    "max_file_duration": "a new file begins after this time, s; 0: never",
    "minimum_free_disk": "with less free space the recording is stopped and its bag closed, B",
    "memory_limit": "messages that cannot be written wait in this much memory, B",
    "max_message_size": "larger messages are counted as malformed and not recorded, B",
    "queue_depth": "messages of a topic that the middleware keeps until they are taken",
    "late_after": "a message is late if it arrives so long after its source stamp, s",
    "status_period": "time between two messages on ~/status and /diagnostics, s",
    "gap_factor": "a pause is a gap if it is so many usual periods long",
}
_RANGES: dict[str, tuple[float, float]] = {
    "chunk_duration": (0.1, 10.0),
    "max_file_size": (0, _LARGEST),
    "max_file_duration": (0.0, 86_400.0),
    "minimum_free_disk": (0, _LARGEST),
    "memory_limit": (1_000_000, _LARGEST),
    "max_message_size": (1_000, _LARGEST),
    "queue_depth": (10, 1_000_000),
    "late_after": (0.001, 3600.0),
    "gap_factor": (1.5, 1000.0),
    "status_period": (0.1, 60.0),
}


def declare(node: Node) -> RecorderSettings:
    """Declare all parameters on a node and return their values.

    Raises
    ------
    UsageError
        A value given at the start is not allowed.
    """
    for field in fields(RecorderSettings):
        try:
            node.declare_parameter(field.name, field.default, _descriptor(field.name))
        except Exception as error:  # rclpy has one class for each thing that can be wrong
            reason = " ".join(str(error).split())
            raise UsageError(f"parameter {field.name}: {reason}") from error
    settings = RecorderSettings(
        **{field.name: node.get_parameter(field.name).value for field in fields(RecorderSettings)}
    )
    try:
        settings.check()
    except IdimError as error:
        raise UsageError(f"parameter {error}") from error
    return settings


def changed(settings: RecorderSettings, parameters: Sequence[Parameter]) -> RecorderSettings:
    """Return the settings with new values.

    Raises
    ------
    UsageError
        A value is not allowed.
    """
    names = {field.name for field in fields(RecorderSettings)}
    values = {field.name: getattr(settings, field.name) for field in fields(RecorderSettings)}
    values.update({each.name: each.value for each in parameters if each.name in names})
    new = RecorderSettings(**values)
    new.check()
    return new


def signals(settings: RecorderSettings) -> tuple[SignalsSection, tuple[str, ...]]:
    """Topics of the configured robot, and its joints (none without configuration)."""
    if not settings.configuration:
        return SignalsSection(), ()
    configuration = load_configuration(Path(settings.configuration))
    return configuration.signals, tuple(configuration.robot.joints)


def _descriptor(name: str) -> ParameterDescriptor:
    descriptor = ParameterDescriptor(
        name=name, description=_TEXT[name], read_only=name in _READ_ONLY
    )
    if name in _RANGES:
        low, high = _RANGES[name]
        if isinstance(getattr(RecorderSettings(), name), float):
            span = FloatingPointRange(from_value=float(low), to_value=float(high))
            descriptor.floating_point_range = [span]
        else:
            descriptor.integer_range = [IntegerRange(from_value=int(low), to_value=int(high))]
    return descriptor
