"""The clock that stamps the messages, and its faults: stray stamps, a clock that was set."""

from dataclasses import dataclass, replace

import numpy as np

from idim_iv_ros.errors import DataError
from idim_iv_ros.recording.bags.joint_messages import JointMessages
from idim_iv_ros.recording.recording import ClockQuality, Note
from idim_iv_ros.recording.sampling import sampling_times
from idim_iv_ros.types import BoolArray, FloatArray, IntArray

GAP = 2.5  # sampling intervals without a message
_MOSTLY_BACKWARD = 0.2
_STAMPED = 0.05  # share of the messages with a new stamp, from which stamps mean something
# Log times are unsigned in a file: further ones are damaged, and their differences would overflow.
_FURTHEST = 1 << 61  # ns

# A step back by more than this many intervals is a clock that was set, not a late message.
_SET_BACK = 20.0
# A step forward by more than this, s and sampling intervals, is a pause or a clock that was set.
_PAUSE, _PAUSE_INTERVALS = 10.0, 100.0
# In a pause the time of arrival advances by this share of it; longer ones are a clock that was set.
_ARRIVES, _LONGEST_PAUSE = 0.5, 86_400.0
# Stretches before one, after which it may go on.
_STRETCHES = 50


@dataclass(frozen=True)
class StampedMessages:
    """Messages sorted by time, one for each stamp; `time` (n,) int, ns, increases."""

    messages: JointMessages
    time: IntArray
    quality: ClockQuality
    notes: tuple[Note, ...]

    def taken(self, places: IntArray) -> "StampedMessages":
        """Return the messages at `places` (k,), in this order."""
        return replace(self, messages=self.messages.taken(places), time=self.time[places])

    def with_values(self, name: str, values: FloatArray, *notes: Note) -> "StampedMessages":
        """Return the messages with other values (n, n_joints) of a field, and notes added."""
        messages = replace(self.messages, values={**self.messages.values, name: values})
        return replace(self, messages=messages, notes=(*self.notes, *notes))


def stamp_messages(messages: JointMessages, where: str) -> StampedMessages:
    """Sort messages by their header stamps, or by arrival if these are constant.

    Raises DataError: too few messages, or time mostly runs backward.
    """
    topic, count = messages.topic, len(messages)
    if count < 2:
        raise DataError(f"{where}: {count} messages on {topic}: nothing to identify from")
    # A driver that leaves stamps empty may still set a few.
    headed = np.count_nonzero(np.diff(messages.stamps)) > _STAMPED * len(messages)
    arrival = np.clip(messages.arrival, -_FURTHEST, _FURTHEST)
    time = messages.stamps if headed else arrival
    arrived = Note(topic, "no header stamps: times of arrival are used", len(messages))
    notes = [] if headed else [arrived]
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
    usable, left_out = on_one_clock(topic, time, arrival, interval)
    notes += left_out
    order = usable[np.argsort(time[usable], kind="stable")]
    late = int(np.count_nonzero(np.diff(order) < 0))
    if late:
        notes.append(Note(topic, "messages out of order were sorted by their stamp", late))
    ordered = time[order]
    if not np.array_equal(order, np.arange(len(messages))):
        messages = messages.taken(order)
    fresh = np.concatenate([[True], np.diff(ordered) > 0])
    messages, repeated = _one_per_stamp(messages, fresh)
    if repeated:
        notes.append(Note(topic, "repeated stamps: the first message of each is kept", repeated))
    ordered = ordered[fresh]
    intervals = np.diff(ordered) * 1e-9
    median = float(np.median(intervals)) if len(intervals) else 0.0
    gaps = int(np.count_nonzero(intervals > GAP * median))
    if gaps:
        notes.append(Note(topic, f"gaps of more than {GAP:g} sampling intervals", gaps))
    usual = intervals[intervals <= GAP * median]
    quality = ClockQuality(
        topic=topic,
        source="header" if headed else "arrival",
        messages=count,
        rate=1.0 / median if median > 0.0 else 0.0,
        jitter=float(np.std(usual)) if len(usual) else 0.0,
        longest_gap=float(intervals.max(initial=0.0)),
        gaps=gaps,
        repeated=repeated,
        backward=backward,
    )
    sampled = ordered
    if "position" in messages.values:
        sampled, share = sampling_times(ordered, messages.values["position"])
    if sampled is not ordered:
        moved = 1e-6 * float(np.std(sampled - ordered))
        what = (
            f"stamps jitter, and the motion shows {100.0 * share:.0f} % of it: samples were taken "
            f"more regularly, and their times are corrected by {moved:.2g} ms (rms)"
        )
        notes.append(Note(topic, what, 1))
    return StampedMessages(messages, sampled, quality, tuple(notes))


def _one_per_stamp(messages: JointMessages, fresh: BoolArray) -> tuple[JointMessages, int]:
    """Merge sorted messages with equal stamps: the first finite number of each joint counts.

    `fresh` (n,) marks the first message of each stamp. Returns the merged messages, and how many
    messages added nothing.
    """
    if fresh.all():
        return messages, 0
    later = np.flatnonzero(~fresh)[::-1]  # the first of several is written last
    first = (np.cumsum(fresh) - 1)[later]
    whole, adds = messages.taken(np.flatnonzero(fresh)), np.zeros(len(later), dtype=bool)
    for name, values in whole.values.items():
        more = messages.values[name][later]
        row, column = np.nonzero(np.isfinite(more) & ~np.isfinite(values[first]))
        adds[row] = True
        values[first[row], column] = more[row, column]
    return whole, int(np.count_nonzero(~adds))


def on_one_clock(
    topic: str, time: IntArray, arrival: IntArray, interval: float
) -> tuple[IntArray, list[Note]]:
    """Find the messages that one clock stamped; leave out stray stamps and those of a clock reset.

    Segments without a jump of time are chained such that most messages remain and time increases.

    `time` and `arrival` (n,) are stamps and times of arrival, `interval` is that of sampling, ns.
    Returns the places (k,) of these messages, and a note on the others.
    """
    # After a pause, too, a stretch begins: a stray time of arrival makes one.
    starts = np.flatnonzero(np.concatenate([[True], ~_is_usual_step(np.diff(time), interval)]))
    stops = np.append(starts[1:], len(time))
    chain = _longest_chain(starts, stops, time, arrival, interval)
    chained = np.isin(np.arange(len(starts)), chain)
    kept = np.repeat(chained, stops - starts)
    if kept.all():
        return np.arange(len(time)), []
    jumps = starts[1:][~(chained[1:] & chained[:-1])]
    first, lost = int(jumps[0]), int(np.count_nonzero(~kept))
    what = (
        f"at message {first + 1} the clock goes from {_seconds(time[first - 1])} to "
        f"{_seconds(time[first])}, the first of {len(jumps)} jumps: of {len(time)} messages {lost} "
        "that another clock stamped are left out"
    )
    return np.flatnonzero(kept), [Note(topic, what, 1, limits=True)]


def _is_usual_step(steps: IntArray, interval: float) -> BoolArray:
    """Return whether steps (n,), ns, are usual for messages with an `interval`, (n,) bool."""
    longest = max(_PAUSE * 1e9, _PAUSE_INTERVALS * interval)
    return np.asarray((steps >= -_SET_BACK * interval) & (steps <= longest))


def _longest_chain(
    starts: IntArray, stops: IntArray, time: IntArray, arrival: IntArray, interval: float
) -> IntArray:
    """Return the segments (k,) of the longest chain along which time increases, by messages."""
    messages, before = stops - starts, np.full(len(starts), -1)
    for stretch in range(1, len(starts)):
        first = max(0, stretch - _STRETCHES)
        start, ends = starts[stretch], stops[first:stretch] - 1
        steps, arrived = time[start] - time[ends], arrival[start] - arrival[ends]
        # By a usual step, or after a pause in which the time of arrival advanced, too.
        pause = (arrived >= _ARRIVES * steps) & (steps > 0) & (steps <= _LONGEST_PAUSE * 1e9)
        follows = _is_usual_step(steps, interval) | pause
        if follows.any():
            before[stretch] = first + int(np.argmax(np.where(follows, messages[first:stretch], 0)))
            messages[stretch] += messages[before[stretch]]
    chain = [int(np.argmax(messages))]
    while before[chain[-1]] >= 0:
        chain.append(int(before[chain[-1]]))
    return np.array(chain[::-1])


def _seconds(stamp: int) -> str:
    return f"{stamp * 1e-9:.3f} s"
