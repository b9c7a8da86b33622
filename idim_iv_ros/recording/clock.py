"""The clock that stamps the messages, and its faults: stray stamps, a clock that was set."""

from dataclasses import dataclass, replace

import numpy as np

from idim_iv_ros.errors import DataError
from idim_iv_ros.recording.bags.joint_messages import JointMessages
from idim_iv_ros.recording.recording import ClockQuality, Note
from idim_iv_ros.types import BoolArray, IntArray

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
        Too few messages, or time mostly runs backward.
    """
    topic, count = messages.topic, len(messages)
    if count < 2:
        raise DataError(f"{where}: {count} messages on {topic}: nothing to identify from")
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
    if not np.array_equal(order, np.arange(len(messages))):
        messages = messages.taken(order)
    fresh = np.concatenate([[True], np.diff(ordered) > 0])
    messages, repeated = _one_of_each_stamp(messages, fresh)
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
        source="header" if source == "header" else "arrival",
        messages=count,
        rate=1.0 / median if median > 0.0 else 0.0,
        jitter=float(np.std(usual)) if len(usual) else 0.0,
        longest_gap=float(intervals.max(initial=0.0)),
        gaps=gaps,
        repeated=repeated,
        backward=backward,
    )
    return StampedMessages(messages, ordered, quality, tuple(notes))


def selected(stamped: StampedMessages, places: IntArray) -> StampedMessages:
    """Messages at `places` (k,), in this order."""
    return replace(stamped, messages=stamped.messages.taken(places), time=stamped.time[places])


def _one_of_each_stamp(messages: JointMessages, fresh: BoolArray) -> tuple[JointMessages, int]:
    """Put sorted messages of one stamp together: of each number the first one counts.

    Returns
    -------
    JointMessages
        One where `fresh` (n,) begins a stamp.
    int
        Messages that added nothing.
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


@dataclass(frozen=True)
class OneClock:
    """Messages that one clock stamped.

    Attributes
    ----------
    kept : (k,) int
        Their places, in the order in which they were found.
    notes : tuple of Note
        What was left out, and why.
    """

    kept: IntArray
    notes: tuple[Note, ...]


def on_one_clock(topic: str, time: IntArray, arrival: IntArray, interval: float) -> OneClock:
    """Leave out what another clock stamped: stray stamps, then all but the longest stretch.

    Parameters
    ----------
    topic
    time, arrival
        (n,) ns: stamps, and when the messages arrived.
    interval
        Sampling interval, ns.
    """
    kept, size = np.arange(len(time)), 1
    while 2 * size < len(kept):
        stray = _stray(time[kept], arrival[kept], interval, size)
        if stray is None:
            break
        kept = kept[~stray]
        size *= 2
    left_out = np.ones(len(time), dtype=bool)
    left_out[kept] = False
    notes = _stray_notes(topic, time, np.flatnonzero(left_out))
    stretch, jump = _longest_stretch(kept, time, arrival, interval)
    if jump is not None:
        lost = len(kept) - len(stretch)
        left = "1 message is left out" if lost == 1 else f"{lost} messages are left out"
        what = f"{jump}: only the longest stretch in order is used, {left}"
        notes.append(Note(topic, what, 1, limits=True))
    return OneClock(stretch, tuple(notes))


def _follows(steps: IntArray, arrived: IntArray, interval: float) -> BoolArray:
    """Whether time went on by `steps`, as usual or after a pause in which `arrived` went on too."""
    usual = steps <= _longest_gap(interval)
    pause = (arrived >= _ARRIVES * steps) & (steps <= _LONGEST_PAUSE * 1e9)
    return np.asarray((steps >= -_SET_BACK * interval) & (usual | pause))


def _longest_gap(interval: float) -> float:
    """Longest step, ns, that needs no explanation."""
    return max(_PAUSE * 1e9, _PAUSE_INTERVALS * interval)


def _stray(time: IntArray, arrival: IntArray, interval: float, size: int) -> BoolArray | None:
    """Mark stretches of up to `size` messages without which time goes on; None for no jump at all.

    A lone message at either end is stray if its delay from stamp to arrival is another than that
    of its neighbours.
    """
    steps = np.diff(time)
    cuts = np.flatnonzero((steps < -_SET_BACK * interval) | (steps > _longest_gap(interval)))
    if len(cuts) == 0:
        return None
    strange = ~_follows(steps[cuts], np.diff(arrival)[cuts], interval)
    starts = np.concatenate([[0], cuts + 1])
    stops = np.concatenate([cuts + 1, [len(time)]])
    length = stops - starts
    edges = np.diff(np.concatenate([[False], length <= size, [False]]).astype(int))
    stray = np.zeros(len(time), dtype=bool)
    for first, after in zip(np.flatnonzero(edges == 1), np.flatnonzero(edges == -1), strict=True):
        before = first - 1
        if before >= 0 and after < len(starts):
            a, b = stops[before] - 1, starts[after]
            joins = _follows(time[[b]] - time[[a]], arrival[[b]] - arrival[[a]], interval)[0]
            shorter = b - a - 1 < min(length[before], length[after])
            if joins and shorter and strange[before:after].any():
                stray[a + 1 : b] = True
        elif size == 1 and (before >= 0 or after < len(starts)):
            neighbour = starts[after] if before < 0 else stops[before] - 1
            places = starts[first:after]
            delay = np.abs(arrival[places] - time[places] - (arrival - time)[neighbour])
            stray[places[delay > _longest_gap(interval)]] = True
    return stray


def _stray_notes(topic: str, time: IntArray, places: IntArray) -> list[Note]:
    if len(places) == 0:
        return []
    where = f"message {places[0] + 1} is stamped {_seconds(time[places[0]])}"
    if len(places) == 1:
        what = f"{where}, far from its neighbours: it is left out"
    else:
        what = f"{len(places)} messages with a stray stamp are left out; the first: {where}"
    return [Note(topic, what, 1, limits=True)]


def _longest_stretch(
    kept: IntArray, time: IntArray, arrival: IntArray, interval: float
) -> tuple[IntArray, str | None]:
    """Longest stretch during which the clock was not set, and where it was."""
    stamps = time[kept]
    steps = np.diff(stamps)
    cuts = np.flatnonzero(~_follows(steps, np.diff(arrival[kept]), interval)) + 1
    if len(cuts) == 0:
        return kept, None
    starts = np.concatenate([[0], cuts])
    stops = np.concatenate([cuts, [len(kept)]])
    longest = int(np.argmax(stops - starts))
    first = cuts[0]
    where = (
        f"at message {kept[first] + 1} the clock "
        f"{'was set back' if steps[first - 1] < 0 else 'jumps forward'} from "
        f"{_seconds(stamps[first - 1])} to {_seconds(stamps[first])}"
    )
    if len(cuts) > 1:
        where += f" (the first of {len(cuts)} jumps)"
    return kept[starts[longest] : stops[longest]], where


def _seconds(stamp: int) -> str:
    return f"{stamp * 1e-9:.3f} s"
