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
_TOPIC = re.compile(r"(?:~/|/)?[A-Za-z_]\w*(?:/[A-Za-z_]\w*)*", re.ASCII)
_NAME_IT = "configuration: name it: --ros-args -p configuration:=ROBOT.yaml"


def _status_period(topics: str = "/diagnostics") -> float:
    return parameter(1.0, f"time between two messages on {topics}, s", (0.1, 60.0), read_only=True)


@dataclass(frozen=True)
class RecorderSettings(Settings):
    """Parameters of the recorder."""

    configuration: str = parameter(
        "",
        "the robot's YAML file, whose topics are recorded; empty: joint_states and "
        "robot_description",
    )
    bag_directory: str = parameter(".", "folder in which the bags are made")
    bag_prefix: str = parameter("recording", "bags are named PREFIX_YYYY_MM_DD-HH_MM_SS")
    record: bool = parameter(False, "start recording at once", read_only=True)
    extra_topics: tuple[str, ...] = parameter(
        ("",), "topics that are recorded as well, of any type whose package is installed"
    )
    extra_topics_regex: str = parameter(
        "", "topics that are recorded as well: those in whose name this expression is found"
    )
    storage_preset: str = parameter(
        "default",
        "default (zstd), none (no compression), fast (lz4) or small (zstd, larger chunks); for the "
        "next bag",
        choices=STORAGE,
    )
    snapshot_duration: float = parameter(
        0.0,
        "the last seconds of all topics that are kept in memory for ~/snapshot; 0: none",
        (0.0, 3600.0),
    )
    snapshot_memory: int = parameter(
        200_000_000, "memory for them; what is older goes earlier, B", (1_000_000, _LARGEST)
    )
    snapshot_on_error: bool = parameter(
        False, "whether a new ERROR of another node on /diagnostics writes a snapshot"
    )
    chunk_duration: float = parameter(1.0, "what a crash can lose at most, s", (0.1, 10.0))
    max_file_size: int = parameter(
        0, "a new file begins when one has so many bytes; 0: never", (0, _LARGEST)
    )
    max_file_duration: float = parameter(
        0.0, "a new file begins after this time, s; 0: never", (0.0, 86_400.0)
    )
    minimum_free_disk: int = parameter(
        200_000_000,
        "with less free space the recording is stopped and its bag closed, B",
        (0, _LARGEST),
    )
    memory_limit: int = parameter(
        500_000_000,
        "messages that cannot be written wait in this much memory, B",
        (1_000_000, _LARGEST),
    )
    max_message_size: int = parameter(
        64_000_000,
        "larger messages are counted as malformed and not recorded, B",
        (1_000, _LARGEST),
    )
    queue_depth: int = parameter(
        20_000,
        "messages of a topic that the middleware keeps until they are taken",
        (10, 1_000_000),
        read_only=True,
    )
    late_after: float = parameter(
        0.1, "a message is late if it arrives so long after its source stamp, s", (0.001, 3600.0)
    )
    gap_factor: float = parameter(
        5.0, "a pause is a gap if it is so many usual periods long", (1.5, 1000.0)
    )
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
        "",
        "the robot's YAML file; setting it again reads it anew. A request may name another file in "
        "its folder",
    )
    bag_directory: str = parameter(".", "requests name bags in this folder and no others")
    output_directory: str = parameter(
        "results",
        "each job writes into a new folder in here; history and last result too",
        read_only=True,
    )
    autostart: bool = parameter(
        True,
        "configure and activate at once; else the node waits for both to be asked for by the "
        "services of its lifecycle",
        read_only=True,
    )
    auto: bool = parameter(False, "identify every complete bag of recorder/bag_closed")
    when_busy: str = parameter(
        WAIT,
        "what happens to a request while another is worked on: wait or refuse",
        choices=(WAIT, REFUSE),
    )
    queue_limit: int = parameter(10, "requests that wait at most; more are refused", (1, 1000))
    job_timeout: float = parameter(600.0, "a job is ended after this time, s", (1.0, 86_400.0))
    max_bag_size: int = parameter(
        20_000_000_000,
        "all bags of a job together, and each file that it unpacks, B",
        (1, _LARGEST),
    )
    memory_limit: int = parameter(
        8_000_000_000, "memory that a job may allocate, B", (100_000_000, _LARGEST)
    )
    history_length: int = parameter(
        100, "identifications that are kept to find drifting parameters", (2, 100_000)
    )
    drift_significance: float = parameter(
        0.01,
        "probability that any parameter of a bag is flagged although none has changed",
        (1e-9, 0.5),
    )
    status_period: float = _status_period()


@dataclass(frozen=True)
class CollectorSettings(Settings):
    """Parameters of the collector."""

    configuration: str = parameter("", "the robot's YAML file; set again, it is read anew")
    allow_motion: bool = parameter(
        False, "whether the robot may be moved; set to false while it moves, it is stopped"
    )
    controller: str = parameter(
        "joint_trajectory_controller",
        "of the robot: its topic joint_trajectory or its action follow_joint_trajectory is used",
        read_only=True,
    )
    interface: str = parameter(
        AUTO,
        "topic, action, or auto: the action where control_msgs is installed and a server is there",
        choices=(TOPIC, ACTION, AUTO),
        read_only=True,
    )
    motion: str = parameter(
        "designed", "designed for the condition number, or random (at once)", choices=MOTIONS
    )
    motion_duration: float = parameter(20.0, "of the motion at full speed, s", (1.0, 1000.0))
    motion_seed: int = parameter(1, "one seed gives one motion", (0, _LARGEST_SEED))
    speed_scale: float = parameter(
        0.5, "share of the limits of speed and acceleration that the motion may use", (0.01, 1.0)
    )
    approach_speed: float = parameter(
        0.1, "share of the robot's limits on the way to the start of the motion", (0.01, 1.0)
    )
    slow_speed: float = parameter(
        0.2, "speed of the slow pass before the recorded one, share of its speed", (0.05, 1.0)
    )
    floor: float = parameter(
        math.nan, "height that all moving frames stay above, m in the base frame; nan: none"
    )
    tracking_error: float = parameter(
        0.1, "a robot that is so far from where it should be is stopped, rad (m)", (0.001, 1.0)
    )
    start_delay: float = parameter(
        1.0, "time until the controller begins a motion at the latest, s", (0.05, 120.0)
    )
    stale_after: float = parameter(
        0.2, "joint states are too old after this time: the robot is stopped, s", (0.02, 10.0)
    )
    point_rate: float = parameter(
        100.0, "points of the trajectory per second at full speed", (10.0, 1000.0)
    )
    job_timeout: float = parameter(
        3600.0, "a goal ends after this time, s; that of a request may be shorter", (1.0, 86_400.0)
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
    result: str = parameter(
        "",
        "a result.json, which is read again when it changes; empty: the newest of the identifier",
    )
    output_directory: str = parameter(
        "results", "where the identifier of this robot writes its results", read_only=True
    )
    rate: float = parameter(20.0, "predictions per second, Hz", (1.0, 100.0), read_only=True)
    frame_prefix: str = parameter(
        "", "in front of the names of links in ~/residual_markers, as of robot_state_publisher"
    )
    false_warnings: float = parameter(
        1.0,
        "warnings a day of motion that are accepted while the model fits, all joints together",
        (1e-6, 1000.0),
    )
    status_period: float = _status_period()

    def __post_init__(self) -> None:
        if not self.configuration:
            raise UsageError(_NAME_IT)


@dataclass(frozen=True)
class SimulatorSettings(Settings):
    """Parameters of the robot simulator."""

    configuration: str = parameter("", "the robot's YAML file", read_only=True)
    trajectory: str = parameter("", "CSV file that ~/move plays; empty: a random motion")
    motion_duration: float = parameter(10.0, "duration of the random motion, s", (1.0, 3600.0))
    motion_seed: int = parameter(1, "seed of the random motion", (0, _LARGEST_SEED))
    seed: int = parameter(1, "seed of the noise", (0, _LARGEST_SEED))

    def __post_init__(self) -> None:
        if not self.configuration:
            raise UsageError(_NAME_IT)
        if self.trajectory:
            # Here, since the other nodes start without it.
            from idim_iv_ros.excitation.trajectory import read_trajectory

            read_trajectory(Path(self.trajectory))
