"""metadata.yaml of a rosbag2 folder, version 9 (ROS 2 Jazzy)."""

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from idim_iv_ros.recording.bags.channel import TopicChannel


@dataclass(frozen=True)
class FileSummary:
    """One file of a bag.

    Attributes
    ----------
    name : str
        Relative to the folder.
    start, duration : int
        Log time of the first message, and from there to the last, ns.
    counts : mapping
        Messages of each topic.
    size : int
        Bytes.
    """

    name: str
    start: int | None
    duration: int
    counts: Mapping[str, int]
    size: int

    @property
    def messages(self) -> int:
        """Messages in the file."""
        return sum(self.counts.values())


def write_metadata(
    folder: Path, files: Sequence[FileSummary], topics: Sequence[TopicChannel]
) -> None:
    """Write metadata.yaml; a reader sees the old one or the new one, never half of one.

    Raises
    ------
    OSError
        It cannot be written; the old one stays.
    """
    text = metadata_text(files, topics)
    temporary = folder / ".metadata.yaml.part"
    try:
        with temporary.open("w", encoding="utf-8") as stream:
            stream.write(text)
            stream.flush()
            os.fsync(stream.fileno())
        temporary.replace(folder / "metadata.yaml")
    finally:
        temporary.unlink(missing_ok=True)


def metadata_text(files: Sequence[FileSummary], topics: Sequence[TopicChannel]) -> str:
    """Return the content of metadata.yaml."""
    start, duration = time_span(files)
    lines = [
        "rosbag2_bagfile_information:",
        "  version: 9",
        "  storage_identifier: mcap",
        *_times(start, duration, "  "),
        f"  message_count: {sum(file.messages for file in files)}",
        "  topics_with_message_count:" + ("" if topics else " []"),
    ]
    for topic in topics:
        lines += _topic(topic, sum(file.counts.get(topic.name, 0) for file in files))
    lines += ['  compression_format: ""', '  compression_mode: ""', "  relative_file_paths:"]
    lines += [f"    - {json.dumps(file.name)}" for file in files]
    lines.append("  files:")
    for file in files:
        lines.append(f"    - path: {json.dumps(file.name)}")
        lines += _times(file.start or 0, file.duration, "      ")
        lines.append(f"      message_count: {file.messages}")
    lines += ["  custom_data: ~", "  ros_distro: jazzy", ""]
    return "\n".join(lines)


def time_span(files: Sequence[FileSummary]) -> tuple[int, int]:
    """First log time of all files, and from there to the last, ns; zero without messages."""
    starts = [file.start for file in files if file.start is not None]
    ends = [file.start + file.duration for file in files if file.start is not None]
    return (min(starts), max(ends) - min(starts)) if starts else (0, 0)


def _times(start: int, duration: int, indent: str) -> list[str]:
    return [
        f"{indent}duration:",
        f"{indent}  nanoseconds: {duration}",
        f"{indent}starting_time:",
        f"{indent}  nanoseconds_since_epoch: {start}",
    ]


def _topic(topic: TopicChannel, count: int) -> list[str]:
    offered = "".join(qos.yaml("          ") for qos in topic.offered).rstrip("\n")
    return [
        "    - topic_metadata:",
        f"        name: {topic.name}",
        f"        type: {topic.message_type}",
        "        serialization_format: cdr",
        "        offered_qos_profiles:" + (f"\n{offered}" if offered else " []"),
        f"        type_description_hash: {topic.type_hash}",
        f"      message_count: {count}",
    ]
