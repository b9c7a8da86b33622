"""Parameters of all nodes, declared once: default, meaning, range."""

import math
import re
from dataclasses import dataclass
from pathlib import Path

from idim_iv_ros.errors import UsageError
from idim_iv_ros.files import require_folder_place
from idim_iv_ros.nodes.parameters import Settings, parameter

WAIT, REFUSE = "wait", "refuse"
TOPIC, ACTION, AUTO = "topic", "action", "auto"
STORAGE = ("default", "none", "fast", "small")
MOTIONS = ("designed", "random")

_LARGEST = 1 << 62
_LARGEST_SEED = 2**31
_DAY = 86_400.0  # s
_TOPIC = re.compile(r"(?:~/|/)?[A-Za-z_]\w*(?:/[A-Za-z_]\w*)*", re.ASCII)
_NAME_IT = "configuration: name it: --ros-args -p configuration:=ROBOT.yaml"


def _status_period(topics: str) -> float:
    return parameter(1.0, f"s, of {topics}", (0.1, 60.0), read_only=True)


@dataclass(frozen=True)
class RecorderSettings(Settings):
    """Parameters of the recorder."""

    configuration: str = parameter(
        "", "the robot's YAML file, for its topics; empty: joint_states and robot_description"
    )
    bag_directory: str = parameter(".", "folder in which the bags are made")
    bag_prefix: str = parameter("recording", "bags are named PREFIX_YYYY_MM_DD-HH_MM_SS")
    record: bool = parameter(False, "start recording at once", read_only=True)
    extra_topics: tuple[str, ...] = parameter(("",), "recorded as well, if the type is installed")
    extra_topics_regex: str = parameter("", "so are topics in whose name this expression is found")
    storage_preset: str = parameter(
        "default", "default (zstd), none, fast (lz4) or small (larger chunks)", choices=STORAGE
    )
    snapshot_duration: float = parameter(0.0, "s, kept for ~/snapshot; 0: none", (0.0, 3600.0))
    snapshot_memory: int = parameter(
        200_000_000, "B, for that; what is older goes earlier", (1_000_000, _LARGEST)
    )
    snapshot_on_error: bool = parameter(False, "a new ERROR on /diagnostics writes a snapshot")
    chunk_duration: float = parameter(1.0, "s, what a crash can lose at most", (0.1, 10.0))
    max_file_size: int = parameter(0, "B, when a new file begins; 0: never", (0, _LARGEST))
    max_file_duration: float = parameter(0.0, "s, when a new file begins; 0: never", (0.0, _DAY))
    minimum_free_disk: int = parameter(
        200_000_000, "B, with less the recording is stopped and its bag closed", (0, _LARGEST)
    )
    memory_limit: int = parameter(
        500_000_000, "B, for messages that cannot be written at present", (1_000_000, _LARGEST)
    )
    max_message_size: int = parameter(
        64_000_000, "B, larger messages are counted as malformed and left out", (1_000, _LARGEST)
    )
    queue_depth: int = parameter(
        20_000, "messages of a topic in the middleware", (10, 1_000_000), read_only=True
    )
    late_after: float = parameter(0.1, "s, from source stamp to receipt", (0.001, 3600.0))
    gap_factor: float = parameter(5.0, "a pause of so many usual periods is a gap", (1.5, 1000.0))
    status_period: float = _status_period("~/status and /diagnostics")

    def __post_init__(self) -> None:
        if not self.bag_prefix or self.bag_prefix != Path(self.bag_prefix).name:
            raise UsageError(f"bag_prefix: {self.bag_prefix!r} is not the name of a folder")
        try:
            re.compile(self.extra_topics_regex)
        except re.error as error:
            raise UsageError(f"extra_topics_regex: no regular expression: {error}") from error
        for name in self.extra_topics:
            if name and not _TOPIC.fullmatch(name):
                raise UsageError(f"extra_topics: {name!r} is no name of a topic")
        try:
            require_folder_place(Path(self.bag_directory))
        except UsageError as error:
            raise UsageError(f"bag_directory: {error}") from error


@dataclass(frozen=True)
class IdentifierSettings(Settings):
    """Parameters of the identifier."""

    configuration: str = parameter(
        "", "the robot's YAML file, read when it is set; requests may name others in its folder"
    )
    bag_directory: str = parameter(".", "requests name bags in this folder and no others")
    output_directory: str = parameter(
        "results", "of one identifier alone: a folder for each job, history", read_only=True
    )
    autostart: bool = parameter(
        True, "false: wait for the services configure and activate of its lifecycle", read_only=True
    )
    auto: bool = parameter(False, "identify every complete bag of recorder/bag_closed")
    when_busy: str = parameter(
        WAIT, "what a request does while another is worked on", choices=(WAIT, REFUSE)
    )
    queue_limit: int = parameter(10, "requests that wait at most; more are refused", (1, 1000))
    job_timeout: float = parameter(600.0, "s, a job is ended after this time of work", (1.0, _DAY))
    max_bag_size: int = parameter(
        20_000_000_000, "B, all bags of a job, and each file that it unpacks", (1, _LARGEST)
    )
    memory_limit: int = parameter(
        8_000_000_000, "B, memory that a job may allocate", (100_000_000, _LARGEST)
    )
    history_length: int = parameter(100, "estimates of each kind that are kept", (2, 100_000))
    drift_significance: float = parameter(
        0.01, "probability of a false alarm of drift in one bag", (1e-9, 0.5)
    )
    status_period: float = _status_period("/diagnostics")


@dataclass(frozen=True)
class CollectorSettings(Settings):
    """Parameters of the collector."""

    configuration: str = parameter("", "the robot's YAML file; set again, it is read anew")
    allow_motion: bool = parameter(False, "the robot may be moved; false while it moves stops it")
    controller: str = parameter(
        "joint_trajectory_controller",
        "its topic joint_trajectory or its action follow_joint_trajectory is used",
        read_only=True,
    )
    interface: str = parameter(
        AUTO, "auto: the action where it can be used", choices=(TOPIC, ACTION, AUTO), read_only=True
    )
    motion: str = parameter(
        "designed", "for the condition number, or random (at once)", choices=MOTIONS
    )
    motion_duration: float = parameter(20.0, "s, at full speed", (1.0, 1000.0))
    motion_seed: int = parameter(1, "one seed gives one motion", (0, _LARGEST_SEED))
    speed_scale: float = parameter(0.5, "share of the limits of speed, acceleration", (0.01, 1.0))
    approach_speed: float = parameter(0.1, "share of them on the way to the start", (0.01, 1.0))
    slow_speed: float = parameter(0.2, "of the slow pass, share of its full speed", (0.05, 1.0))
    floor: float = parameter(math.nan, "m in the base frame, all frames stay above; nan: none")
    tracking_error: float = parameter(0.1, "rad (m), further off it is stopped", (0.001, 1.0))
    start_delay: float = parameter(1.0, "s until the controller begins at most", (0.05, 120.0))
    stale_after: float = parameter(0.2, "s without joint states, then it is stopped", (0.02, 10.0))
    point_rate: float = parameter(100.0, "points per second at full speed", (10.0, 1000.0))
    job_timeout: float = parameter(
        3600.0, "s, a goal ends after this time; a request may name less", (1.0, _DAY)
    )

    def __post_init__(self) -> None:
        if not self.controller:
            raise UsageError("controller: name the controller that follows trajectories")
        if math.isinf(self.floor):
            raise UsageError("floor: a height in m, or nan")


@dataclass(frozen=True)
class PredictorSettings(Settings):
    """Parameters of the predictor."""

    configuration: str = parameter("", "the robot's YAML file", read_only=True)
    result: str = parameter("", "a result.json, read when it changes; empty: the identifier's")
    output_directory: str = parameter("results", "where the identifier writes", read_only=True)
    rate: float = parameter(20.0, "Hz, predictions per second", (1.0, 100.0), read_only=True)
    frame_prefix: str = parameter("", "in front of the names of links in ~/residual_markers")
    false_warnings: float = parameter(
        1.0, "a day of motion that are accepted while the model fits, all joints", (1e-6, 1000.0)
    )
    status_period: float = _status_period("/diagnostics")

    def __post_init__(self) -> None:
        if not self.configuration:
            raise UsageError(_NAME_IT)


@dataclass(frozen=True)
class SimulatorSettings(Settings):
    """Parameters of the robot simulator."""

    configuration: str = parameter("", "the robot's YAML file", read_only=True)
    trajectory: str = parameter("", "CSV file that ~/move plays; empty: a random motion")
    motion_duration: float = parameter(10.0, "s, of the random motion", (1.0, 3600.0))
    motion_seed: int = parameter(1, "of the random motion", (0, _LARGEST_SEED))
    seed: int = parameter(1, "of the noise", (0, _LARGEST_SEED))

    def __post_init__(self) -> None:
        if not self.configuration:
            raise UsageError(_NAME_IT)
        if self.trajectory:  # the other nodes start without this module
            from idim_iv_ros.excitation.trajectory import read_trajectory

            read_trajectory(Path(self.trajectory))
