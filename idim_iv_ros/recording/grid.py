"""One uniform time grid for all signals of a bag, and values for stretches without measurement.

Long pauses are shortened, and positions in gaps get a motion with continuous velocity. These
samples are left out of every estimate, but the filters run across them, the cut-offs are chosen
from the whole spectrum and the closed loop is simulated through them: a corner at the edge of a gap
would be an acceleration that the robot never had.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from idim_iv_ros.recording.bags.joint_messages import JointMessages
from idim_iv_ros.recording.clock import GAP, stamp_messages
from idim_iv_ros.recording.recording import Note, Signal, stretches_of
from idim_iv_ros.types import BoolArray, FloatArray, IntArray

_SPLINE_SAMPLES = 8  # samples from which on a stretch without a gap is interpolated by a spline
# Numbers up to which all joints are interpolated at once: an hour of all would fill the memory.
_AT_ONCE = 100_000
_ON_GRID = 1e-3  # stamps this close to the grid (share of an interval) lie on it
_EARLY = 0.25  # share of a sample by which a value may come late and still count for it
_DRIFT = 0.25  # a rounded rate may drift by this share of a sample over the recording

# A longer step without a message is shortened to this, s: time for a joint to be elsewhere after it
# without having to be fast, and short compared with the memory that a recording takes anyway.
LONGEST_PAUSE = 10.0

# Time, and samples at least, from which the speed at the edge of a gap is taken.
_EDGE, _EDGE_SAMPLES = 0.1, 8  # s
_STOP = 0.5  # s, in which a joint comes to rest in a long gap, and starts again at its end


@dataclass(frozen=True)
class Grid:
    """Uniform grid: sample k lies at `start` (ns) + k / `rate` (Hz)."""

    start: int
    rate: float
    samples: int

    @property
    def time(self) -> FloatArray:
        """Return the times of the samples from the start, (n_samples,) s."""
        return np.arange(self.samples) / self.rate


def make_grid(time: IntArray, first: int, last: int) -> Grid:
    """Return the grid at the rate of stamps `time` (n,), ns, from the first in `first` … `last`.

    The rate is the mean one without gaps, rounded to whole Hz if that shifts no sample noticeably.
    """
    steps = np.diff(time) * 1e-9
    median = float(np.median(steps))
    count = int(np.round(steps / median).sum())
    rate = count / float(steps.sum())
    whole = round(rate)
    if whole > 0 and abs(rate / whole - 1.0) * count < _DRIFT:
        rate = float(whole)
    inside = time[(time >= first) & (time <= last)]
    if len(inside) == 0:
        return Grid(int(first), rate, 0)
    start = int(inside[0])
    return Grid(start, rate, int((last - start) * 1e-9 * rate + 0.01) + 1)


def on_grid(
    grid: Grid,
    time: IntArray,
    values: FloatArray,
    origin: str,
    *,
    smooth: bool = False,
    stepwise: bool = False,
) -> Signal:
    """Interpolate values (n, n_joints) at stamps `time` (n,), ns, on the grid by cubic splines.

    Stamps that lie on the grid give their values bit for bit. A sample is invented in a gap, or
    where no value is finite; with `smooth`, gaps are bridged with continuous velocity (`bridged`).
    With `stepwise` a value holds until the next stamp; samples before the first are invented.
    """
    seconds: FloatArray = (time - grid.start).astype(np.float64) * 1e-9
    median = float(np.median(np.diff(time))) * 1e-9 if len(time) > 1 else 1.0 / grid.rate
    first = round(float(seconds[0]) * grid.rate)
    place = seconds * grid.rate - first - np.arange(len(seconds))
    if np.all(np.abs(place) < _ON_GRID):  # consecutive samples of the grid
        direct = values[-first : grid.samples - first] if first <= 0 else None
        if direct is not None and len(direct) == grid.samples:
            invented = ~np.isfinite(direct)
            if not invented.any():
                return Signal(read_only(direct), read_only(invented), origin)
    target, finite = grid.time, np.isfinite(values)
    out = np.empty((grid.samples, values.shape[1]))
    invented = np.empty(out.shape, dtype=bool)
    columns = np.arange(values.shape[1])
    together = finite.all() and values.size <= _AT_ONCE
    for joints in [columns] if together else np.split(columns, len(columns)):
        measured = finite[:, joints[0]]
        stamps = seconds[measured]
        if len(stamps) == 0:
            out[:, joints], invented[:, joints] = 0.0, True
            continue
        if stepwise:
            last = np.searchsorted(stamps, target + _EARLY / grid.rate, side="right") - 1
            out[:, joints] = values[measured][np.maximum(last, 0)][:, joints]
            invented[:, joints] = (last < 0)[:, None]
            continue
        gap = GAP * max(median, 1.0 / grid.rate)
        out[:, joints] = _resample(target, stamps, values[measured][:, joints], gap)
        invented[:, joints] = _in_gap(target, stamps, gap)[:, None]
        for joint in joints if smooth else ():
            bridged(out[:, joint], invented[:, joint], grid.rate)
    return Signal(read_only(out), read_only(invented), origin)


def _resample(target: FloatArray, stamps: FloatArray, values: FloatArray, gap: float) -> FloatArray:
    """Interpolate values (n, k) from `stamps` (n,) to `target` (m,), s: splines, linear in gaps.

    A line keeps cos(π f / rate) of a signal at f: at a third of the Nyquist frequency 13 % are
    lost, and 0.4 % by a spline.
    """
    from scipy.interpolate import make_interp_spline  # here, because it takes half a second

    out = np.stack([np.interp(target, stamps, column) for column in values.T], axis=1)
    cuts = np.flatnonzero(np.diff(stamps) > gap) + 1
    for part in np.split(np.arange(len(stamps)), cuts):
        if len(part) < _SPLINE_SAMPLES:
            continue
        first, last = np.searchsorted(target, stamps[part[[0, -1]]], side="left")
        inside = slice(int(first), int(last))
        out[inside] = make_interp_spline(stamps[part], values[part], k=3)(target[inside])
    return np.asarray(out)


def _in_gap(target: FloatArray, stamps: FloatArray, gap: float) -> NDArray[np.bool_]:
    """Return whether each `target` (m,), s, lies in a gap of the `stamps` (n,), s."""
    after = np.searchsorted(stamps, target, side="left")
    before, after = (np.clip(place, 0, len(stamps) - 1) for place in (after - 1, after))
    nearest = np.minimum(np.abs(target - stamps[before]), np.abs(stamps[after] - target))
    wide = (stamps[after] - stamps[before] > gap) & (nearest >= 1e-3 * gap)
    outside = (target < stamps[0]) | (target > stamps[-1])
    return np.asarray(wide | (outside & (nearest > gap)))


def read_only(array: NDArray[Any]) -> NDArray[Any]:
    """Make an array read-only, and return it."""
    array.setflags(write=False)
    return array


Pauses = tuple[IntArray, IntArray]
"""Intervals to cut out of time: where they begin and end, (k,) ns each."""


def pauses_of(states: JointMessages) -> tuple[Pauses, list[Note]]:
    """Return the parts of long pauses to cut out, and a note if there are any."""
    time = states.stamps
    steps = np.diff(time)
    shortest = max(round(LONGEST_PAUSE * 1e9), 3 * int(np.median(steps)))
    long = np.flatnonzero(steps > shortest)
    begin, end = time[long] + shortest, time[long + 1]
    if len(long) == 0:
        return (begin, end), []
    removed = float((end - begin).sum()) * 1e-9
    longest = float(steps[long].max()) * 1e-9
    first = float(time[long[0]] - time[0]) * 1e-9
    count = "a pause" if len(long) == 1 else f"{len(long)} pauses, the longest"
    what = (
        f"{count} of {longest:.4g} s, first {first:.4g} s after the start: {shortest * 1e-9:g} s "
        f"of each are kept, so that later times of this recording are up to {removed:.4g} s early"
    )
    return (begin, end), [Note(states.topic, what, 1, limits=True)]


def without_pauses(
    stamped: Mapping[str, JointMessages], pauses: Pauses
) -> Mapping[str, JointMessages]:
    """Cut pauses out of all topics."""
    begin, end = pauses
    if len(begin) == 0:
        return stamped
    removed, shortened = np.concatenate([[0], np.cumsum(end - begin)]), {}
    for topic, messages in stamped.items():
        pause = np.searchsorted(begin, messages.stamps, side="right") - 1
        outside = (pause < 0) | (messages.stamps >= end[np.maximum(pause, 0)])
        kept = messages if outside.all() else messages.taken(np.flatnonzero(outside))
        before = removed[np.searchsorted(end, kept.stamps, side="right")]
        shortened[topic] = replace(kept, stamps=kept.stamps - before)
    return shortened


def bridged(values: FloatArray, invented: BoolArray, rate: float) -> None:
    """Replace the invented ones of the values (n,) of one joint by a smooth motion, in place."""
    begins, ends = stretches_of(invented)
    since = np.concatenate([[0], ends])  # where what is measured before each gap begins
    until = np.concatenate([begins[1:], [len(values)]])
    edge = max(_EDGE_SAMPLES, round(_EDGE * rate))
    for gap, (begin, end) in enumerate(zip(begins.tolist(), ends.tolist(), strict=True)):
        if begin == 0 or end == len(values):
            continue
        before = values[max(int(since[gap]), begin - edge) : begin]
        after = values[end : min(int(until[gap]), end + edge)]
        duration = (end - begin + 1) / rate
        # From the last measured sample to the next, with the speeds there.
        speeds = _edge_velocity(before[::-1], -rate), _edge_velocity(after, rate)
        ends_at = float(before[-1]), float(after[0])
        seconds = np.arange(1, end - begin + 1) / rate
        values[begin:end] = _bridge(seconds, duration, ends_at, speeds)


def _edge_velocity(samples: FloatArray, rate: float) -> float:
    """Return the slope at the first of the samples (n,), by a parabola (few: a line), 1/s."""
    if len(samples) < 2:
        return 0.0
    degree = 2 if len(samples) >= _EDGE_SAMPLES else 1
    return rate * float(np.polyfit(np.arange(len(samples)), samples, degree)[-2])


def _bridge(
    seconds: FloatArray, duration: float, ends: tuple[float, float], speeds: tuple[float, float]
) -> FloatArray:
    """Return positions at `seconds` (n,) between two ends with given velocities, `duration` apart.

    In a long gap it slows down to rest, and speeds up at the end.
    """
    from scipy.interpolate import CubicHermiteSpline  # here, because it takes half a second

    if duration <= 4.0 * _STOP:
        return np.asarray(CubicHermiteSpline([0.0, duration], ends, speeds)(seconds))
    rests = ends[0] + 0.5 * _STOP * speeds[0], ends[1] - 0.5 * _STOP * speeds[1]
    times = [0.0, _STOP, duration - _STOP, duration]
    spline = CubicHermiteSpline(times, [ends[0], *rests, ends[1]], [speeds[0], 0.0, 0.0, speeds[1]])
    return np.asarray(spline(seconds))


@dataclass(frozen=True)
class Part:
    """Joints whose values come in the same messages, and these messages by source.

    An arm and its gripper may have separate messages on one topic, with other stamps and rates:
    every part is sorted, stamped and interpolated separately.
    """

    columns: IntArray  # (k,), places of its joints among all
    joints: tuple[str, ...]
    stamped: Mapping[str, JointMessages]  # with these columns only


def parts_of(sources: Mapping[str, JointMessages], names: Sequence[str], where: str) -> list[Part]:
    """Split the messages of all sources into parts: joints that come together in every source.

    Raises DataError: see `stamp_messages`.
    """
    labels = []
    for messages in sources.values():
        label = np.arange(messages.named.shape[1])
        for layout in messages.named:
            together = np.isin(label, label[layout])
            label[together] = np.min(label[together], initial=len(label))
        present = messages.named.any(axis=0)
        # Joints that are never named split nothing.
        label[~present] = label[present][0] if present.any() else 0
        labels.append(label)
    _, label = np.unique(labels, axis=1, return_inverse=True)
    parts = []
    for joints in (np.flatnonzero(label == part) for part in dict.fromkeys(label.ravel().tolist())):
        of_joints = {source: _messages_of(sources[source], joints) for source in sources}
        stamped = {source: stamp_messages(some, where) for source, some in of_joints.items()}
        parts.append(Part(joints, tuple(names[joint] for joint in joints.tolist()), stamped))
    return parts


def _messages_of(messages: JointMessages, joints: IntArray) -> JointMessages:
    """Return the messages that name some of the joints, or none, with their columns only."""
    layouts = np.flatnonzero(messages.named[:, joints].any(axis=1) | ~messages.named.any(axis=1))
    kept = np.isin(messages.layout, layouts if len(layouts) else messages.layout)
    chosen = messages if kept.all() else messages.taken(np.flatnonzero(kept))
    if len(joints) == messages.named.shape[1]:
        return chosen
    values = {name: value[:, joints] for name, value in chosen.values.items()}
    return replace(chosen, values=values, named=messages.named[:, joints])


def joined(
    grid: Grid, parts: Sequence[Part], source: str, name: str, *, stepwise: bool = False
) -> Signal:
    """Return one quantity of all joints on the grid, each part interpolated from its stamps.

    `stepwise`: a value holds until the next one, as commands of servos do.
    """
    topics = [part.stamped[source] for part in parts]
    origin = f"{topics[0].topic} {topics[0].origins.get(name, name)}"
    options = {"smooth": name == "position", "stepwise": stepwise}
    signals = [on_grid(grid, of.stamps, of.values[name], origin, **options) for of in topics]
    if len(parts) == 1:
        return signals[0]
    order = np.argsort(np.concatenate([part.columns for part in parts]))
    values = np.hstack([signal.values for signal in signals])[:, order]
    invented = np.hstack([signal.invented for signal in signals])[:, order]
    return Signal(read_only(values), read_only(invented), origin)
