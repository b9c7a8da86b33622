"""Which clock stamps the messages, and what is wrong with it."""

from dataclasses import dataclass, replace

import numpy as np

from idim_iv_ros.errors import DataError
from idim_iv_ros.recording.bags.joint_messages import JointMessages
from idim_iv_ros.recording.clock_jumps import on_one_clock
from idim_iv_ros.recording.recording import ClockQuality, Note
from idim_iv_ros.types import IntArray

GAP = 2.5  # sampling intervals without a message
_MOSTLY_BACKWARD = 0.2
_STAMPED = 0.05  # share of the messages with a new stamp, from which stamps mean something
# Log times are unsigned in a file: further ones are damaged, and their differences would overflow.
_FURTHEST = 1 << 61  # ns


@dataclass(frozen=True)
class StampedMessages:
    """Messages with strictly increasing times.

    Attributes
    ----------
    messages : JointMessages
        Sorted, without repeated stamps.
    time : (n,) int
        ns.
    quality : ClockQuality
    notes : tuple of Note
    """

    messages: JointMessages
    time: IntArray
    quality: ClockQuality
    notes: tuple[Note, ...]


def stamp_messages(messages: JointMessages, where: str) -> StampedMessages:
    """Sort messages by their header stamps, or by arrival where the stamps say nothing.

    Raises
    ------
    DataError
        Too few messages, or time runs backward for good.
    """
    topic = messages.topic
    if len(messages) < 2:
        raise DataError(f"{where}: {len(messages)} messages on {topic}: nothing to identify from")
    # Of a driver that fills in no stamps, a few may be set all the same.
    headed = np.count_nonzero(np.diff(messages.stamps)) > _STAMPED * len(messages)
    arrival = np.clip(messages.arrival, -_FURTHEST, _FURTHEST)
    time = messages.stamps if headed else arrival
    source = "header" if headed else "arrival"
    notes = []
    if not headed:
        what = "no header stamps: times of arrival are used"
        notes.append(Note(topic, what, len(messages)))
    steps = np.diff(time)
    forward = steps[steps > 0]
    if len(forward) == 0:
        raise DataError(f"{where}: time never advances on {topic}")
    interval = float(np.median(forward))
    backward = int(np.count_nonzero(steps < 0))
    if backward > _MOSTLY_BACKWARD * len(steps):
        raise DataError(
            f"{where}: time goes backward in {backward} of {len(steps)} steps on {topic}; the "
            "recording cannot be put in order"
        )
    one_clock = on_one_clock(topic, time, arrival, interval)
    notes += one_clock.notes
    kept = one_clock.kept
    order = kept[np.argsort(time[kept], kind="stable")]
    late = int(np.count_nonzero(np.diff(order) < 0))
    if late:
        notes.append(Note(topic, "messages out of order were sorted by their stamp", late))
    ordered = time[order]
    fresh = np.concatenate([[True], np.diff(ordered) > 0])
    repeated = int(np.count_nonzero(~fresh))
    if repeated:
        notes.append(Note(topic, "repeated stamps: the first message of each is kept", repeated))
    order, ordered = order[fresh], ordered[fresh]
    intervals = np.diff(ordered) * 1e-9
    median = float(np.median(intervals)) if len(intervals) else 0.0
    gaps = int(np.count_nonzero(intervals > GAP * median))
    if gaps:
        notes.append(Note(topic, f"gaps of more than {GAP:g} sampling intervals", gaps))
    usual = intervals[intervals <= GAP * median]
    quality = ClockQuality(
        topic=topic,
        source="header" if source == "header" else "arrival",
        messages=len(messages),
        rate=1.0 / median if median > 0.0 else 0.0,
        jitter=float(np.std(usual)) if len(usual) else 0.0,
        longest_gap=float(intervals.max(initial=0.0)),
        gaps=gaps,
        repeated=repeated,
        backward=backward,
    )
    if np.array_equal(order, np.arange(len(messages))):
        return StampedMessages(messages, ordered, quality, tuple(notes))
    return StampedMessages(_taken(messages, order), ordered, quality, tuple(notes))


def selected(stamped: StampedMessages, places: IntArray) -> StampedMessages:
    """Messages at `places` (k,), in this order."""
    return replace(stamped, messages=_taken(stamped.messages, places), time=stamped.time[places])


def _taken(messages: JointMessages, places: IntArray) -> JointMessages:
    return replace(
        messages,
        stamps=messages.stamps[places],
        arrival=messages.arrival[places],
        values={name: values[places] for name, values in messages.values.items()},
    )
