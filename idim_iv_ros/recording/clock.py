"""The clock that stamps the messages, and its faults: stray stamps, a clock that was set, jitter.

A driver that reads its encoders on a regular clock stamps them when it comes to it. Interpolated
from such stamps, a joint at 1 rad/s has 0.3 mrad of noise for 0.3 ms of jitter, and much more in
its acceleration. Stamps that are right are needed as much: a sample that was taken late shows it.
"""

from dataclasses import replace

import numpy as np
import scipy

from idim_iv_ros.errors import DataError
from idim_iv_ros.recording.bags.joint_messages import JointMessages
from idim_iv_ros.recording.recording import ClockQuality, Note
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
_STRETCHES = 50  # stretches before one, after which it may go on

_WANDER = 1.0  # s over which the regular clock may wander from a constant rate
_DRIFT = 25  # samples over which a rate that is a little off does not matter
_LEAST_JITTER = 2e-3  # of an interval
_WINDOW, _ORDER = 9, 3  # samples and order of the local polynomials that positions are smooth by
_BLOCKS = 16  # left out in turn for the deviation
_CLEAR = 3.0  # standard deviations
_RIGHT = 0.9  # share of the jitter in the positions from which on stamps are as good as right


def stamp_messages(messages: JointMessages, where: str) -> JointMessages:
    """Sort messages by their header stamps, or by arrival if these are constant; one a stamp.

    Raises DataError: too few messages, or time mostly runs backward.
    """
    topic, count = messages.topic, len(messages)
    if count < 2:
        raise DataError(f"{where}: {count} messages on {topic}: nothing to identify from")
    # A driver that leaves stamps empty may still set a few.
    headed = np.count_nonzero(np.diff(messages.stamps)) > _STAMPED * count
    arrival = np.clip(messages.arrival, -_FURTHEST, _FURTHEST)
    time = messages.stamps if headed else arrival
    notes = [] if headed else [Note(topic, "no header stamps: times of arrival are used", count)]
    steps = np.diff(time)
    if steps.max() <= 0:
        raise DataError(f"{where}: time never advances on {topic}")
    interval = float(np.median(steps[steps > 0]))
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
    if not np.array_equal(order, np.arange(count)):
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
    return replace(messages, stamps=sampled, clock=quality, said=tuple(notes))


def _one_per_stamp(messages: JointMessages, fresh: BoolArray) -> tuple[JointMessages, int]:
    """Merge sorted messages with equal stamps, of which `fresh` (n,) marks the first ones.

    The first finite number of each joint counts. Also returns how many messages added nothing.
    """
    later = np.flatnonzero(~fresh)[::-1]  # the first of several is written last
    if not len(later):
        return messages, 0
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

    `time`, `arrival` (n,): stamps and times of arrival; `interval`: of sampling, ns. Segments
    without a jump of time are chained such that most messages remain and time increases.
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
        f"at message {first + 1} the clock goes from {time[first - 1] * 1e-9:.3f} s to "
        f"{time[first] * 1e-9:.3f} s, the first of {len(jumps)} jumps: of {len(time)} messages "
        f"{lost} that another clock stamped are left out"
    )
    return np.flatnonzero(kept), [Note(topic, what, 1, limits=True)]


def _is_usual_step(steps: IntArray, interval: float) -> BoolArray:
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


def sampling_times(time: IntArray, position: FloatArray) -> tuple[IntArray, float]:
    """Return when positions (n, k) with stamps `time` (n,), ns, were sampled, (n,) ns.

    Stamps are a clock that is regular over a second, and jitter. A joint that moves shows the share
    of the jitter with which its samples were taken, 1 to 0, which is returned, too: 1, with the
    stamps as they are, unless the positions clearly say less.
    """
    if len(time) < _BLOCKS * _WINDOW:
        return time, 1.0
    steps = np.diff(time)
    interval = float(steps.sum()) / max(float(np.rint(steps / np.median(steps)).sum()), 1.0)
    stamps = (time - time[0]) / interval
    # Jitter of more than half an interval is counted as none or two: the phase drifts by it.
    drift = _phase(stamps, _DRIFT)
    interval *= 1.0 + float(drift[-1] - drift[0]) / float(stamps[-1])
    stamps = (time - time[0]) / interval
    phase = _phase(stamps, max(int(1e9 * _WANDER / interval), _WINDOW))
    order = np.arange(len(stamps))
    # Places of the stamps on the clock, in intervals and no two the same; some are passed over.
    free = scipy.optimize.isotonic_regression(stamps - phase - order).x
    places = np.rint(free).astype(np.int64) + order
    jitter = stamps - places - phase
    if float(np.std(jitter)) < _LEAST_JITTER:
        return time, 1.0
    share, std = _share_in(position, jitter, places)
    if not share + _CLEAR * std < _RIGHT:
        return time, 1.0
    share = max(share, 0.0)
    return time - np.rint((1.0 - share) * jitter * interval).astype(np.int64), share


def _phase(stamps: FloatArray, width: int) -> FloatArray:
    """Circular mean (n,) of `width` stamps: messages that are missing do not move it."""
    turns = scipy.ndimage.uniform_filter1d(np.exp(2j * np.pi * stamps), width, mode="nearest")
    return np.asarray(np.unwrap(np.angle(turns)) / (2.0 * np.pi))


def _share_in(position: FloatArray, jitter: FloatArray, places: IntArray) -> tuple[float, float]:
    """Share of the jitter (n,), in intervals, that is in the positions, with its deviation.

    The mean of the joints' shares, by the inverse of their variances; that of none is infinite.
    """
    whole = np.convolve(np.diff(places, prepend=places[0] - 1) == 1, np.ones(_WINDOW), "same")
    whole = whole == _WINDOW
    if np.count_nonzero(whole) < _BLOCKS * _WINDOW:
        return 1.0, np.inf
    slope = scipy.signal.savgol_coeffs(_WINDOW, _ORDER, deriv=1)
    edges = np.linspace(0, np.count_nonzero(whole), _BLOCKS, endpoint=False, dtype=int)
    weighted = weights = 0.0
    for joint in position.T[np.isfinite(position).all(axis=0)]:
        speed = scipy.signal.savgol_filter(joint, _WINDOW, _ORDER, deriv=1)
        rough, shown = (
            (x - scipy.signal.savgol_filter(x, _WINDOW, _ORDER))[whole]
            for x in (joint, speed * jitter)
        )
        # Noise of the positions moves nothing by its own speed.
        of_noise = float(np.mean(rough**2)) * float(slope @ slope) * jitter[whole] ** 2
        products = np.add.reduceat(shown * rough, edges)
        squares = np.add.reduceat(shown**2 - of_noise, edges)
        rest = squares.sum() - squares
        if squares.sum() <= 0.0 or np.any(rest <= 0.0):
            continue
        variance = (_BLOCKS - 1) * float(np.var((products.sum() - products) / rest))
        weight = 1.0 / max(variance, 1e-12)
        weighted += weight * float(products.sum() / squares.sum())
        weights += weight
    return (weighted / weights, weights**-0.5) if weights else (1.0, np.inf)
