"""From bags to recordings: the door through which everything enters."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from idim_iv_ros.errors import DataError, UsageError
from idim_iv_ros.file_paths import FilePaths, as_paths
from idim_iv_ros.recording.bag import Bag
from idim_iv_ros.recording.clock import StampedMessages, stamp_messages
from idim_iv_ros.recording.description import robot_description
from idim_iv_ros.recording.frozen_channels import without_frozen
from idim_iv_ros.recording.grid import Grid, make_grid, on_grid
from idim_iv_ros.recording.joint_messages import JointMessageReader, JointMessages, readable
from idim_iv_ros.recording.recording import Note, Recording, Signal
from idim_iv_ros.recording.unused_references import unused_references

FloatArray = NDArray[np.float64]
Progress = Callable[[str, float], None]

DESCRIPTION = "/robot_description"
LEAST_SAMPLES = 20


def read_recordings(
    bags: FilePaths,
    *,
    joints: Sequence[str] | str,
    joint_states: str = "/joint_states",
    effort: str | None = None,
    reference: str | None = None,
    progress: Progress | None = None,
) -> tuple[Recording, ...]:
    """Read one recording from each bag.

    Parameters
    ----------
    bags
        One or several MCAP files, .db3 files or rosbag2 folders: text or paths.
    joints
        Joints to read, in the order of the columns of every signal; one name for one joint.
    joint_states, effort, reference
        Topics; `effort` is that of `joint_states` if it is None.

    Raises
    ------
    UsageError
        No such bag, or one recording twice.
    DataError
        A bag cannot be read, or does not hold what is asked for.
    """
    recordings: list[Recording] = []
    joints = [joints] if isinstance(joints, str) else list(joints)
    paths = as_paths(bags)
    for number, bag in enumerate(paths):
        if progress is not None:
            progress(f"reading {bag.name}", 0.3 * number / len(paths))
        recording = _read(bag, joints, joint_states, effort or joint_states, reference)
        _require_new(recording, recordings)
        recordings.append(recording)
    return tuple(recordings)


def _require_new(recording: Recording, before: Sequence[Recording]) -> None:
    """Refuse a recording that is given twice: it would pass for a repeat without any noise."""
    for other in before:
        if (
            recording.start == other.start
            and np.array_equal(recording.effort.values, other.effort.values)
            and np.array_equal(recording.position.values, other.position.values)
        ):
            raise UsageError(
                f"{recording.path}: the same recording as {other.path}; give each one once"
            )


def _read(
    path: Path, joints: Sequence[str], joint_states: str, effort: str, reference: str | None
) -> Recording:
    fields: dict[str, set[str]] = {joint_states: {"position", "velocity"}}
    fields.setdefault(effort, set()).add("effort")
    if reference is not None:
        fields.setdefault(reference, set()).update(("position", "velocity"))
    bag = Bag(path)
    readers: dict[str, JointMessageReader] = {}
    description: str | None = None
    for topic, batch in bag.batches({*fields, DESCRIPTION}):
        if topic == DESCRIPTION:
            description = robot_description(batch) or description
            continue
        if topic not in readers:
            _require_type(path, topic, bag.topics[topic])
            readers[topic] = JointMessageReader(
                topic, bag.topics[topic], joints, sorted(fields[topic])
            )
        readers[topic].add(batch)
    for topic in fields:
        if topic not in readers:
            advice = ""
            if topic == reference and bag.topics:
                advice = _reference_advice(bag, list(fields), joints)
            raise DataError(f"{_missing(path, bag, topic)}{advice}")
    stamped = {topic: stamp_messages(_checked(path, readers[topic]), str(path)) for topic in fields}
    notes = [Note(*loss) for loss in bag.losses]
    topics = (joint_states, effort, reference)
    recording = _assemble(path, joints, stamped, topics, description, notes)
    if reference is not None:
        return recording
    return replace(recording, unused_references=unused_references(bag, list(fields), joints))


def _reference_advice(bag: Bag, used: Sequence[str], joints: Sequence[str]) -> str:
    """Say what to write where the reference is not on the topic that was named."""
    found = unused_references(bag, used, joints)
    if found:
        return f"; if the reference is on {found[0]}, write `reference: {found[0]}` under signals"
    return "; name that of the reference in signals.reference, or leave it out"


def _checked(path: Path, reader: JointMessageReader) -> JointMessages:
    messages = reader.finish()
    if len(messages) == 0:
        raise DataError(f"{path}: no message on {reader.topic} can be read")
    for name in reader.fields:
        if name == "velocity":
            continue
        for column, joint in enumerate(reader.joints):
            if messages.names and joint not in messages.names:
                raise DataError(
                    f"{path}: {reader.topic} never holds joint {joint}; it holds "
                    f"{', '.join(messages.names)}; name the joints to be read in robot.joints"
                )
            values = messages.values[name][:, column]
            if not np.isfinite(values).any():
                raise DataError(
                    f"{path}: {name} of {joint} on {reader.topic} is empty or NaN in every message"
                )
    return messages


def _assemble(
    path: Path,
    joints: Sequence[str],
    stamped: dict[str, StampedMessages],
    topics: tuple[str, str, str | None],
    description: str | None,
    notes: list[Note],
) -> Recording:
    joint_states, effort, reference = topics
    needed = [stamped[joint_states], stamped[effort]]
    first = max(int(topic.time[0]) for topic in needed)
    last = min(int(topic.time[-1]) for topic in needed)
    if last <= first:
        raise DataError(f"{path}: {joint_states} and {effort} do not overlap in time")
    grid = make_grid(stamped[joint_states].time, first, last)
    if grid.samples < LEAST_SAMPLES:
        raise DataError(
            f"{path}: {grid.samples} samples are too few to identify anything; record for longer"
        )
    for topic in stamped.values():
        notes += topic.notes
        notes += _message_notes(topic.messages)
    stamped, frozen = without_frozen(stamped, joint_states, effort, joints, grid.start)
    sources = {topic.quality.source for topic in stamped.values()}
    if len(sources) > 1:
        notes.append(Note(effort, "topics with different clocks: their delay is not known", 1))
    torque = _signal(grid, stamped[effort], "effort")
    for column, joint in enumerate(joints):
        if not torque.values[:, column].any():
            raise DataError(
                f"{path}: effort of {joint} on {effort} is zero throughout: the driver does not "
                "publish it"
            )
    return Recording(
        path=path,
        joints=tuple(joints),
        rate=grid.rate,
        start=grid.start * 1e-9,
        position=_signal(grid, stamped[joint_states], "position"),
        effort=torque,
        velocity=_optional(grid, stamped[joint_states], "velocity"),
        position_reference=_signal(grid, stamped[reference], "position") if reference else None,
        velocity_reference=_optional(grid, stamped[reference], "velocity") if reference else None,
        clocks=tuple(topic.quality for topic in stamped.values()),
        notes=tuple(notes),
        robot_description=description,
        frozen=frozen,
    )


def _signal(grid: Grid, stamped: StampedMessages, name: str) -> Signal:
    values = stamped.messages.values[name]
    return on_grid(grid, stamped.time, values, f"{stamped.messages.topic} {name}")


def _optional(grid: Grid, stamped: StampedMessages, name: str) -> Signal | None:
    """Return None where a joint never has this field."""
    if not np.isfinite(stamped.messages.values[name]).any(axis=0).all():
        return None
    return _signal(grid, stamped, name)


def _message_notes(messages: JointMessages) -> list[Note]:
    notes = []
    if messages.damaged:
        notes.append(Note(messages.topic, "damaged messages were left out", messages.damaged))
    if messages.layouts > 1:
        what = "different layouts of the message (joint order or missing fields)"
        notes.append(Note(messages.topic, what, messages.layouts))
    for name, values in messages.values.items():
        missing = int(np.count_nonzero(~np.isfinite(values)))
        if missing and missing < values.size:
            notes.append(Note(messages.topic, f"{name}: values missing or NaN", missing))
    return notes


def _require_type(path: Path, topic: str, message_type: str) -> None:
    if not readable(message_type):
        raise DataError(
            f"{path}: {topic} is {message_type}; sensor_msgs/msg/JointState or "
            "std_msgs/msg/Float64MultiArray is needed"
        )


def _missing(path: Path, bag: Bag, topic: str) -> str:
    if not bag.topics:
        reason = "".join(f" ({what})" for _, what, _ in bag.losses)
        return f"{path}: the bag is empty{reason}"
    usable = [name for name, kind in bag.topics.items() if readable(kind)]
    if topic in bag.topics:
        return f"{path}: no message on {topic}"
    if not usable:
        return f"{path}: no topic {topic}, nor any other topic with joint states"
    return f"{path}: no topic {topic}; joint states are on {', '.join(sorted(usable))}"
