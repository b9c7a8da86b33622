"""Parameters of the recorder."""

import re
from dataclasses import dataclass
from pathlib import Path

from idim_iv_ros.errors import UsageError
from idim_iv_ros.files import require_folder_place
from idim_iv_ros.nodes.parameters import Settings, check_configuration, parameter, period_of_status
from idim_iv_ros.recording.writing.write import PRESETS

_LARGEST = 1 << 62
_TOPIC = re.compile(r"(?:~/|/)?[A-Za-z_]\w*(?:/[A-Za-z_]\w*)*", re.ASCII)


@dataclass(frozen=True)
class RecorderSettings(Settings):
    """Values of the parameters; the names are the same."""

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
    status_period: float = period_of_status("~/status and /diagnostics")

    def check(self) -> None:
        """Check what the ranges cannot express."""
        if not self.bag_prefix or self.bag_prefix != Path(self.bag_prefix).name:
            raise UsageError(f"bag_prefix: {self.bag_prefix!r} is not the name of a folder")
        if self.storage_preset not in PRESETS:
            raise UsageError(
                f"storage_preset: {self.storage_preset!r} is none of {', '.join(PRESETS)}"
            )
        try:
            re.compile(self.extra_topics_regex)
        except re.error as error:
            raise UsageError(f"extra_topics_regex: no regular expression: {error}") from error
        for name in self.extra_topics:
            if name and not _TOPIC.fullmatch(name):
                raise UsageError(f"extra_topics: {name!r} is no name of a topic")
        if self.configuration:
            check_configuration(self.configuration)
        try:
            require_folder_place(Path(self.bag_directory))
        except UsageError as error:
            raise UsageError(f"bag_directory: {error}") from error
