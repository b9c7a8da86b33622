"""Measurements that hold their last value while the robot goes on: a sensor or a bus dropped out.

An exact repeat is no fault by itself. A quantised channel repeats while it changes by less than a
step, a slow one between two updates, a saturated one at its limit, any of them while the joint
rests. What is called frozen is longer than all of these and happens while the joint moves; where
repeats are usual, or the channel is too smooth for that, it must end in a jump as well.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from idim_iv_ros.recording.clock import StampedMessages
from idim_iv_ros.recording.recording import FrozenStretches
from idim_iv_ros.types import BoolArray, FloatArray, IntArray

_LONGER = 5.0  # times the usual repeats of the channel
_LEAST_REPEATS = 5  # equal values after the first one
_LEAST_VALUES, _MOST_VALUES = 50, 20_000  # by which fine and coarse channels differ
# Of the values that a channel takes one after the other, how many are new in a fine channel.
_DISTINCT = 0.9
# Second over first differences (medians): √3 in white noise, near 0 in a smooth signal.
_NOISY = 0.5
# Quantiles of the lengths of runs that are usual; a fine channel has few runs, frozen ones among
# them.
_MOST_FINE, _MOST_COARSE = 0.9, 0.99
# Of the runs between so many times the usual and what is frozen, for each one that is frozen.
_GAP, _BETWEEN = 3.0, 0.2
# Share of samples that repeat the one before; more do where the noise is below a step.
_OFTEN = 0.6
# A frozen run of a coarse channel: no other within so many times its length is longer than
# 1 / _LONGER of it.
_AROUND = 3
# A jump: this many times the largest of the steps that follow.
_JUMP = 3.0
_STEPS_AFTER = 10
# Share of the joint's peak speed from which it moves.
_MOVES = 0.02
# Of that speed, from which a fine and noisy effort has no reason to repeat.
_CREEPS = 0.25


def without_frozen(
    stamped: dict[str, StampedMessages],
    joint_states: str,
    effort: str,
    joints: Sequence[str],
    start: int,
) -> tuple[dict[str, StampedMessages], tuple[FrozenStretches, ...]]:
    """Take out what efforts and positions repeat while they are frozen.

    Parameters
    ----------
    stamped
        Messages of each topic.
    joint_states, effort
        Topics of the positions and of the efforts.
    joints
    start
        Of the recording, ns.

    Returns
    -------
    dict
        The same messages, with NaN for frozen values.
    tuple of FrozenStretches
    """
    states, efforts = stamped[joint_states], stamped[effort]
    positions, torques = states.messages.values["position"], efforts.messages.values["effort"]
    found: list[FrozenStretches] = []
    lost = np.zeros(positions.shape, dtype=bool), np.zeros(torques.shape, dtype=bool)
    for column, joint in enumerate(joints):
        position = positions[:, column]
        lost[0][:, column] = frozen_positions(position, moving_speed(position))
        there = _at(efforts.time, states.time, position)
        lost[1][:, column] = frozen_efforts(torques[:, column], there, moving_speed(there))
        for name, topic, frozen in (
            ("position", states, lost[0][:, column]),
            ("effort", efforts, lost[1][:, column]),
        ):
            channel = f"{name} of {joint} on {topic.messages.topic}"
            seconds: FloatArray = (topic.time - start).astype(np.float64) * 1e-9
            stretches = described(channel, frozen, seconds)
            found += [] if stretches is None else [stretches]
    if not found:
        return stamped, ()
    cleaned = dict(stamped)
    cleaned[joint_states] = _without(cleaned[joint_states], "position", lost[0])
    cleaned[effort] = _without(cleaned[effort], "effort", lost[1])
    return cleaned, tuple(found)


def _at(wanted: IntArray, time: IntArray, position: FloatArray) -> FloatArray:
    """Positions at the times of the efforts, linearly where these are others."""
    if wanted is time or np.array_equal(wanted, time):
        return position
    known = np.isfinite(position)
    begin = time[0]
    return np.asarray(np.interp(wanted - begin, time[known] - begin, position[known]))


def _without(stamped: StampedMessages, field: str, lost: BoolArray) -> StampedMessages:
    values = np.where(lost, np.nan, stamped.messages.values[field])
    messages = replace(stamped.messages, values={**stamped.messages.values, field: values})
    return replace(stamped, messages=messages)


def frozen_efforts(effort: FloatArray, position: FloatArray, speed: float) -> BoolArray:
    """Mark the repeats of an effort that is frozen.

    Parameters
    ----------
    effort
        (n,) of one joint, as published.
    position
        (n,) of the same joint at the same times.
    speed
        From which the joint moves, per sample; see `moving_speed`.
    """
    first, last = _runs(effort)
    moved = _moved(position, first, last, speed)
    usual = _usual(effort[first], last - first + 1, moved)
    if usual is None:
        return np.zeros(len(effort), dtype=bool)
    finite = effort[np.isfinite(effort)]
    value = effort[first]
    inside = (value > finite.min()) & (value < finite.max()) & (value != 0.0)
    if usual.fine and usual.random:
        moved = _moved(position, first, last, _CREEPS * speed)
    chosen = (last - first > usual.most) & moved & inside
    if not usual.random:
        chosen &= _jumps(effort, first, last)
    elif not usual.fine:
        chosen[chosen] = _alone(last - first + 1, np.flatnonzero(chosen))
    return _repeats(len(effort), first[chosen], last[chosen])


def frozen_positions(position: FloatArray, speed: float) -> BoolArray:
    """Mark the repeats of a position that is frozen and then jumps to where the joint has gone."""
    first, last = _runs(position)
    moved = _moved(position, first, last, speed)
    usual = _usual(position[first], last - first + 1, moved)
    if usual is None:
        return np.zeros(len(position), dtype=bool)
    chosen = (last - first > usual.most) & moved & _jumps(position, first, last)
    return _repeats(len(position), first[chosen], last[chosen])


def moving_speed(position: FloatArray) -> float:
    """Speed from which a joint moves, per sample; infinite where it never does."""
    known = position[np.isfinite(position)]
    span = max(2, min(20, len(known) // 10))
    if len(known) <= span:
        return np.inf
    speeds = np.abs(known[span:] - known[:-span]) / span
    peak = float(np.quantile(speeds, 0.99))
    return _MOVES * peak if peak > 0.0 else np.inf


def _runs(values: FloatArray) -> tuple[IntArray, IntArray]:
    """First and last place of each run of equal values; a missing value equals none."""
    new = np.flatnonzero(np.concatenate([[True], values[1:] != values[:-1]]))
    return new, np.concatenate([new[1:] - 1, [len(values) - 1]])


def _moved(position: FloatArray, first: IntArray, last: IntArray, speed: float) -> BoolArray:
    """Whether the joint moves during a run, up to the first sample after it; it may turn once."""
    after = np.minimum(last + 1, len(position) - 1)
    middle = position[(first + after) // 2]
    distance = np.abs(middle - position[first]) + np.abs(position[after] - middle)
    return np.asarray(distance >= speed * np.maximum(after - first, 1))


@dataclass(frozen=True)
class _Usual:
    """Most repeats that are usual, and whether more are a fault by themselves (`random`).

    In a `fine` channel a value hardly ever comes twice.
    """

    most: float
    fine: bool
    random: bool


def _usual(held: FloatArray, lengths: IntArray, moved: BoolArray) -> _Usual | None:
    """Describe the repeats of a channel while its joint moves, from the runs of equal values.

    Repeats are random where the channel is noisy and its noise passes a step at most times. Where
    the noise is smaller, some values last while others flicker: there is no gap between the
    lengths of short and of long runs. None where there are too few values, or hardly any repeat.
    """
    few = np.count_nonzero(moved & np.isfinite(held)) < _LEAST_VALUES
    if few or lengths[moved].max() <= _LEAST_REPEATS:
        return None
    sample = held[:: -(-len(held) // _MOST_VALUES)]
    fine = len(np.unique(sample)) > _DISTINCT * len(sample)
    moving = lengths[moved]
    usual = float(np.quantile(moving, _MOST_FINE if fine else _MOST_COARSE))
    most = max(_LONGER * usual, _LEAST_REPEATS + 1.0)
    steps = np.diff(held)
    slopes, bends = np.nanmedian(np.abs(steps)), np.nanmedian(np.abs(np.diff(steps)))
    longer = np.count_nonzero(moving > most)
    between = np.count_nonzero((moving > _GAP * usual) & (moving <= most))
    repeated = 1.0 - len(moving) / float(moving.sum())
    noisy = bends > _NOISY * slopes
    random = noisy and (fine or (between <= _BETWEEN * longer and repeated < _OFTEN))
    return _Usual(most - 1.0, bool(fine), bool(random))


def _alone(lengths: IntArray, chosen: IntArray) -> BoolArray:
    """Whether the runs around each chosen one are much shorter, frozen ones aside."""
    ends = np.cumsum(lengths)
    frozen = np.zeros(len(lengths), dtype=bool)
    frozen[chosen] = True
    others = np.where(frozen, 0, lengths)
    alone = np.empty(len(chosen), dtype=bool)
    for place, run in enumerate(chosen):
        around = _AROUND * lengths[run]
        begin, end = np.searchsorted(ends, [ends[run] - lengths[run] - around, ends[run] + around])
        alone[place] = _LONGER * others[begin : end + 1].max() <= lengths[run]
    return alone


def _jumps(values: FloatArray, first: IntArray, last: IntArray) -> BoolArray:
    """Whether a run ends in a step that is much larger than those after it."""
    steps = np.concatenate([np.abs(np.diff(values)), np.full(_STEPS_AFTER + 2, np.nan)])
    steps = np.where(np.isfinite(steps), steps, 0.0)
    after = np.lib.stride_tricks.sliding_window_view(steps, _STEPS_AFTER).max(axis=1)
    smallest = float(np.min(steps[steps > 0.0], initial=np.inf))
    return np.asarray(steps[last] > _JUMP * np.maximum(after[last + 1], smallest))


def _repeats(size: int, first: IntArray, last: IntArray) -> BoolArray:
    """All places of the runs but the first: that one was measured."""
    change = np.zeros(size + 1, dtype=int)
    change[first + 1] += 1
    change[last + 1] -= 1
    return np.asarray(np.cumsum(change)[:size] > 0)


def described(channel: str, frozen: BoolArray, seconds: FloatArray) -> FrozenStretches | None:
    """Describe what was found at times `seconds` (n,) of the recording; None for nothing."""
    if not frozen.any():
        return None
    edges = np.diff(np.concatenate([[False], frozen, [False]]).astype(int))
    first, end = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    lengths = seconds[end - 1] - seconds[first - 1]
    samples = int(np.count_nonzero(frozen))
    return FrozenStretches(
        channel=channel,
        samples=samples,
        share=samples / len(frozen),
        stretches=len(first),
        first=float(seconds[first[0] - 1]),
        longest=float(lengths.max()),
    )
