"""Reading bags into recordings."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from idim_iv_ros.errors import DataError, UsageError
from idim_iv_ros.files import FilePaths
from idim_iv_ros.progress import Progress
from idim_iv_ros.recording.bags.folder import Bag, bags_of, loss_notes
from idim_iv_ros.recording.bags.joint_message_type import may_hold_joints
from idim_iv_ros.recording.bags.joint_messages import JointMessages, checked_messages
from idim_iv_ros.recording.frozen_channels import without_frozen
from idim_iv_ros.recording.grid import (
    Grid,
    Part,
    joined,
    make_grid,
    parts_of,
    pauses_of,
    without_pauses,
)
from idim_iv_ros.recording.recording import FrozenStretches, Note, Recording, Signal
from idim_iv_ros.recording.request import (
    BagMessages,
    Request,
    in_bag,
    prismatic_joints,
    unused_references,
)
from idim_iv_ros.recording.wraps import without_wraps
from idim_iv_ros.signal_source import NO_EFFORT, topic_of

LEAST_SAMPLES = 20
# A grid with many more samples than messages consists of gaps.
_NOTED = 0.1  # s that are cut off without a note
_SAMPLES_A_MESSAGE, _SAMPLES_MORE = 20, 100_000


def read_recordings(
    bags: FilePaths,
    *,
    joints: Sequence[str] | str,
    joint_states: str = "/joint_states",
    effort: str | None = None,
    reference: str | None = None,
    prismatic: Collection[str] = (),
    link_states: str | None = None,
    resolved_topics: Mapping[str, str] | None = None,
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
        Topics; `effort` is that of `joint_states` if it is None, and ``none`` where the robot has
        no efforts: they are zeros then. A name without a leading slash is looked for in the
        namespace of the robot (`in_bag`). Of a message with references and measurements the
        suitable ones are read, or the named field: ``topic#field``.
    prismatic
        Prismatic joints (also read from a bag's /robot_description): positions are not unwrapped.
    link_states
        Topic of encoders behind the gears; joints may be missing there.
    resolved_topics
        Full names that the calling node has for names without a leading slash; tried first.

    Raises
    ------
    UsageError
        No such bag, or one recording twice.
    DataError
        A bag cannot be read, or lacks a topic, a joint or a quantity.
    """
    names = [joints] if isinstance(joints, str) else list(joints)
    request = Request(
        names,
        joint_states,
        None if effort == NO_EFFORT else effort or joint_states,
        reference,
        prismatic,
        link_states,
        resolved_topics or {},
    )
    return read_requested(bags, request, progress)


def read_requested(
    bags: FilePaths, request: Request, progress: Progress | None = None
) -> tuple[Recording, ...]:
    """Read one recording from each bag; see `read_recordings`."""
    recordings: list[Recording] = []
    opened = bags_of(bags)
    for number, bag in enumerate(opened):
        if progress is not None:
            progress(f"reading {bag.path.name}", 0.3 * number / len(opened))
        recording = read_bag(bag, request)
        for other in recordings:
            # It would pass for a repeat without any noise.
            if (
                recording.start == other.start
                and np.array_equal(recording.effort.values, other.effort.values)
                and np.array_equal(recording.position.values, other.position.values)
            ):
                same = f"the same recording as {other.path}"
                raise UsageError(f"{bag.path}: {same}; give each one once")
        recordings.append(recording)
    return tuple(recordings)


def read_bag(bag: Bag, request: Request) -> Recording:
    """Read the recording of one bag; see `read_recordings`."""
    try:
        messages = BagMessages(bag, in_bag(bag, request))
        for topic, batch in bag.batches(messages.topics):
            messages.add(topic, batch)
    except OSError as error:
        raise UsageError(f"{bag.path}: cannot be read: {error.strerror or error}") from error
    recording, request = recording_of(messages), messages.request
    if request.reference is not None:
        return recording
    unused = unused_references(bag, list(request.fields), request.joints)
    return replace(recording, unused_references=unused)


def recording_of(messages: BagMessages) -> Recording:
    """Return the recording made of the messages of all sources, on one grid.

    Raises DataError: a topic, a joint or a field is missing, or the messages make no recording;
    with what was lost or left out, which is a likely reason.
    """
    bag, request = messages.bag, messages.request
    sources: dict[str, JointMessages] = {}
    notes = loss_notes(bag, request.topics)
    try:
        for source in request.fields:
            if source not in messages.readers:
                raise DataError(_missing_topic(bag, source, request))
            optional, reader = source == request.link_states, messages.readers[source]
            sources[source], left_out = checked_messages(bag.path, reader, optional=optional)
            notes += left_out
        parts = parts_of(sources, request.joints, str(bag.path))
        made = _assemble(bag.path, request, parts, messages.description, notes)
    except DataError as error:
        words = "".join(f" ({note.sentence})" for note in notes)
        raise DataError(f"{error}{words}") from error
    return replace(made, other_positions=sources[request.joint_states].ranges)


def _assemble(
    path: Path, request: Request, parts: list[Part], description: str | None, notes: list[Note]
) -> Recording:
    """Unwrap, cut, clean and resample the parts, and return them as one recording."""
    joint_states, effort, reference = request.joint_states, request.effort, request.reference
    joints, links = request.joints, request.link_states
    if len(parts) > 1:
        listed = "; ".join(", ".join(part.joints) for part in parts)
        what = f"the joints come in {len(parts)} messages, put together: {listed}"
        notes.append(Note(joint_states, what, 1))
    pauses, of_pauses = pauses_of(parts[0].stamped[joint_states])
    notes += of_pauses
    prismatic = {*request.prismatic, *prismatic_joints(description or "")}
    followers = [source for source in (reference, links) if source is not None]
    for number, part in enumerate(parts):
        stamped = without_pauses(part.stamped, pauses)
        stamped = without_wraps(stamped, joint_states, followers, part.joints, prismatic)
        parts[number] = replace(part, stamped=stamped)
    grid, inactive = _common_grid(path, request, parts)
    notes += inactive
    frozen: tuple[FrozenStretches, ...] = ()
    for number, part in enumerate(parts):
        for source, topic in part.stamped.items():
            notes += topic.notes(some_joints=source == links)
        if effort is not None:
            stamped, more = without_frozen(
                part.stamped, joint_states, effort, part.joints, grid.start
            )
            parts[number], frozen = replace(part, stamped=stamped), frozen + more
    topics = [topic for part in parts for topic in part.stamped.values()]
    clocks = [topic.clock for topic in topics if topic.clock is not None]
    if len({clock.source for clock in clocks}) > 1:
        what = "topics with different clocks: their delay is not known"
        notes.append(Note(joint_states, what, 1))
    if effort is None:
        shape = grid.samples, len(joints)
        torque = Signal(np.zeros(shape), np.zeros(shape, dtype=bool), "no effort")
    else:
        torque = joined(grid, parts, effort, "effort")
        for joint in np.flatnonzero(~torque.values.any(axis=0))[:1]:
            why = (
                "is zero throughout: the driver does not publish it; record it, or leave the joint "
                "out of robot.joints if it carries none that moves"
            )
            if torque.invented[:, joint].all():
                why = "is missing wherever positions are recorded"
            raise DataError(f"{path}: effort of {joints[joint]} on {effort} {why}")
    asked = None
    if reference:
        asked = joined(grid, parts, reference, "position", stepwise=effort is None)
    return Recording(
        path=path,
        joints=tuple(joints),
        rate=grid.rate,
        start=grid.start * 1e-9,
        position=joined(grid, parts, joint_states, "position"),
        effort=torque,
        velocity=_velocity(grid, parts, joint_states),
        position_reference=asked,
        velocity_reference=_velocity(grid, parts, reference) if reference else None,
        link_position=joined(grid, parts, links, "position") if links else None,
        clocks=tuple(dict.fromkeys(clocks)),
        notes=tuple(dict.fromkeys(notes)),
        robot_description=description,
        frozen=frozen,
    )


def _common_grid(path: Path, request: Request, parts: Sequence[Part]) -> tuple[Grid, list[Note]]:
    """Return the grid of the time that all topics cover, at the rate of the slowest part.

    And a note if time was cut off because the controller was not active. Raises DataError: the
    topics do not overlap, or there are too few samples or too many gaps.
    """
    states = max(
        (part.stamped[request.joint_states].stamps for part in parts),
        key=lambda time: float(np.median(np.diff(time))),
    )
    topics = [stamped for part in parts for stamped in part.stamped.items()]
    measured = (request.joint_states, request.effort)
    needed = [topic.stamps for source, topic in topics if source in measured]
    first = max(int(time[0]) for time in needed)
    last = min(int(time[-1]) for time in needed)
    jumps = [note.sentence for _, topic in topics for note in topic.said if note.limits]
    because = f" ({'; '.join(dict.fromkeys(jumps))})" if jumps else ""
    apart = f"do not overlap in time{because}"
    notes: list[Note] = []
    if last <= first:
        raise DataError(f"{path}: {request.joint_states} and {request.effort} {apart}")
    for source, topic in topics:
        if topic.stamps[-1] < first or topic.stamps[0] > last:
            raise DataError(f"{path}: {source} and {request.joint_states} {apart}")
        if source == request.reference:
            # Outside, the control law does not act. A plain topic of references limits nothing:
            # after its last message the robot stands still.
            begin, end = first, last
            active = topic.stamps[np.isfinite(topic.values["position"]).all(axis=1)]
            if topic.origins and len(active):
                begin, end = max(first, int(active[0])), min(last, int(active[-1]))
            before, after = (begin - first) * 1e-9, (last - end) * 1e-9
            if max(before, after) >= _NOTED:
                what = (
                    f"the controller is not active in the first {before:.3g} s and the last "
                    f"{after:.3g} s, which are left out"
                )
                notes.append(Note(topic_of(source), what, 1))
            first, last = begin, end
    grid = make_grid(states, first, last)
    if grid.samples > _SAMPLES_A_MESSAGE * len(states) + _SAMPLES_MORE:
        raise DataError(
            f"{path}: {len(states)} messages on {request.joint_states} in "
            f"{(last - first) * 1e-9:.4g} s at {grid.rate:.4g} Hz: most of the recording is "
            f"missing; record again without pauses, or in several bags{because}"
        )
    if grid.samples < LEAST_SAMPLES:
        raise DataError(
            f"{path}: {grid.samples} samples are too few to identify anything; record for longer"
            f"{because}"
        )
    return grid, notes


def _velocity(grid: Grid, parts: Sequence[Part], source: str) -> Signal | None:
    """Return the velocities of a source; None if some joint has none."""
    values = (part.stamped[source].values["velocity"] for part in parts)
    complete = all(np.isfinite(velocity).any(axis=0).all() for velocity in values)
    return joined(grid, parts, source, "velocity") if complete else None


def _missing_topic(bag: Bag, topic: str, request: Request) -> str:
    path = bag.path
    if not bag.topics:
        return f"{path}: {'nothing can be read of it' if bag.damages else 'the bag is empty'}"
    advice = ""
    if topic == request.reference and not bag.damages:
        advice = "; name that of the reference in signals.reference, or leave it out"
        for first in unused_references(bag, list(request.fields), request.joints)[:1]:
            advice = f"; if the reference is on {first}, write `reference: {first}` under signals"
    usable = [name for name, kind in bag.topics.items() if may_hold_joints(kind)]
    if topic_of(topic) in bag.topics:
        return f"{path}: no message on {topic}{advice}"
    if not usable:
        return f"{path}: no topic {topic}, nor any other topic with joint states{advice}"
    listed = ", ".join(sorted(usable))
    return f"{path}: no topic {topic}; joint states are on {listed}{advice}"


# s; at 1 kHz and seven joints an identification of so much takes less than a gigabyte. Filters
# lose about a tenth of a second at each edge.
SEGMENT = 300.0
_BEHIND = 2  # a topic this many segments behind the others has ended, and is not waited for


def read_segments(
    bag: Bag, request: Request, seconds: float = SEGMENT
) -> Iterator[Recording | DataError]:
    """Yield a bag in recordings of about `seconds`; a bag of up to 1.5 segments is not split.

    Segments end at the same arrival time in all topics; the last one lasts 0.5 to 1.5 segments. A
    segment that lacks something is yielded as its error, since others may be complete.

    Raises UsageError: no such bag. DataError or OSError: the bag or its files cannot be read.
    """

    def recorded(messages: BagMessages) -> Recording | DataError:
        try:
            return recording_of(messages)
        except DataError as error:
            return error

    messages = BagMessages(bag, in_bag(bag, request))
    latest = dict.fromkeys(messages.request.topics, 0)
    length, end = round(1e9 * seconds), 0
    for topic, batch in bag.batches(messages.topics):
        if topic in latest and len(batch):
            end = end or int(batch.arrival.min()) + length
            # All topics are half a segment behind the end, as far as they go on. Topics of a chunk
            # come one after the other: when one comes again, the chunk before is done, and a topic
            # that was not in it for two segments has ended.
            ended = latest[topic] - _BEHIND * length
            while min(latest.values()) >= end + length // 2 or ended >= end:
                yield recorded(messages.before(end))
                end += length
            latest[topic] = max(latest[topic], int(batch.arrival.max()))
        messages.add(topic, batch)
    while end and max(latest.values()) >= end + length // 2:
        yield recorded(messages.before(end))
        end += length
    yield recorded(messages)
