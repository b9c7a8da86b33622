"""Measurements that repeat their last value while the joint moves: a sensor or a bus dropped out.

An exact repeat is no fault by itself. A quantised channel repeats while it changes by less than a
step, a slow one between two updates, a saturated one at its limit, any of them while the joint
rests. A run of equal values is called frozen if the joint moves and it is much longer than the
usual runs and those around it; where the channel is smooth it must end in a jump instead.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from idim_iv_ros.recording.bags.joint_messages import JointMessages
from idim_iv_ros.recording.recording import FrozenStretches, stretches_of
from idim_iv_ros.types import BoolArray, FloatArray, IntArray

_LONGER = 5.0  # times the usual repeats of the channel
_LEAST_REPEATS = 5  # equal values after the first one
_LEAST_VALUES = 50  # of a moving joint, from which repeats are usual or not
_MOST = 0.99  # quantile of the lengths of runs that are usual
# Second over first differences (medians): √3 in white noise, near 0 in a smooth signal.
_NOISY = 0.5
# A frozen run of a coarse channel: no other within so many times its length is longer than
# 1 / _LONGER of it.
_AROUND = 3
_JUMP = 3.0  # a jump: this many times the largest of the steps that follow
_STEPS_AFTER = 10
_MOVES = 0.02  # share of the joint's peak speed from which it moves


def without_frozen(
    stamped: Mapping[str, JointMessages],
    joint_states: str,
    effort: str,
    joints: Sequence[str],
    start: int,
) -> tuple[Mapping[str, JointMessages], tuple[FrozenStretches, ...]]:
    """Replace frozen values of efforts and positions by NaN, and describe the frozen stretches.

    `joint_states` and `effort` are their topics, `start` is that of the recording, ns.
    """
    states, efforts = stamped[joint_states], stamped[effort]
    sources = {"position": joint_states, "effort": effort}
    values = {name: stamped[source].values[name] for name, source in sources.items()}
    frozen = {name: np.zeros(channel.shape, dtype=bool) for name, channel in values.items()}
    stretches: list[FrozenStretches] = []
    for column, joint in enumerate(joints):
        aligned = position = values["position"][:, column]
        speed = moving_speed(position)
        frozen["position"][:, column] = frozen_runs(position, position, speed, jumps=True)
        if not np.array_equal(efforts.stamps, states.stamps):
            finite, begin = np.isfinite(position), states.stamps[0]
            measured = states.stamps[finite] - begin, position[finite]
            aligned = np.interp(efforts.stamps - begin, *measured)
        torque = values["effort"][:, column]
        frozen["effort"][:, column] = frozen_efforts(torque, aligned, moving_speed(aligned))
        for name, source in sources.items():
            if frozen[name][:, column].any():
                channel = f"{name} of {joint} on {stamped[source].topic}"
                seconds: FloatArray = (stamped[source].stamps - start).astype(np.float64) * 1e-9
                stretches.append(_describe(channel, frozen[name][:, column], seconds))
    cleaned = dict(stamped)
    for name, source in sources.items() if stretches else ():
        measured_values = np.where(frozen[name], np.nan, values[name])
        cleaned[source] = cleaned[source].with_values(name, measured_values)
    return cleaned, tuple(stretches)


def frozen_efforts(effort: FloatArray, position: FloatArray, speed: float) -> BoolArray:
    """Mark the frozen values of an effort, (n,) bool; the first value of each run is measured.

    `effort`, `position` (n,): of one joint at the same times, the first as published. `speed`: from
    which the joint moves, per sample; see `moving_speed`.
    """
    frozen = frozen_runs(effort, position, speed, jumps=False)
    if frozen.any():
        finite = effort[np.isfinite(effort)]
        # At its limits a driver clips; zero is what it shows without torque.
        frozen &= (effort > finite.min()) & (effort < finite.max()) & (effort != 0.0)
    return frozen


def frozen_runs(
    values: FloatArray, position: FloatArray, speed: float, *, jumps: bool
) -> BoolArray:
    """Mark runs of equal values (n,) that are unusually long while the joint moves, (n,) bool.

    With `jumps`, and where the channel is smooth, a run must end in a jump; else it must be much
    longer than the runs around it. `speed` as in `frozen_efforts`.
    """
    none = np.zeros(len(values), dtype=bool)
    # Runs of equal values; a missing value equals none.
    first = np.flatnonzero(np.concatenate([[True], values[1:] != values[:-1]]))
    last = np.concatenate([first[1:] - 1, [len(values) - 1]])
    lengths = last - first + 1
    # Most channels end here, and cost nothing more.
    if lengths.max(initial=0) <= _LEAST_REPEATS + 1:
        return none
    after = np.minimum(last + 1, len(position) - 1)
    middle = position[(first + after) // 2]
    distance = np.abs(middle - position[first]) + np.abs(position[after] - middle)
    moved = distance >= speed * np.maximum(after - first, 1)
    if np.count_nonzero(moved & np.isfinite(values[first])) < _LEAST_VALUES:
        return none
    usual = float(np.quantile(lengths[moved], _MOST))
    chosen = moved & (lengths > max(_LONGER * usual, _LEAST_REPEATS + 1.0))
    if not chosen.any():
        return none
    changes = np.diff(values[first])
    slopes, bends = np.abs(changes), np.abs(np.diff(changes))
    slopes, bends = slopes[np.isfinite(slopes)], bends[np.isfinite(bends)]
    # Noise passes a step of the channel at most times.
    noisy = len(bends) > 0 and np.median(bends) > _NOISY * np.median(slopes)
    if jumps or not noisy:
        # The step behind the run is much larger than those that follow.
        steps = np.concatenate([np.abs(np.diff(values)), np.full(_STEPS_AFTER + 2, np.nan)])
        steps = np.where(np.isfinite(steps), steps, 0.0)
        following = np.lib.stride_tricks.sliding_window_view(steps, _STEPS_AFTER).max(axis=1)
        smallest = float(np.min(steps[steps > 0.0], initial=np.inf))
        chosen &= steps[last] > _JUMP * np.maximum(following[last + 1], smallest)
    else:
        chosen[chosen] = _is_isolated(lengths, moved, np.flatnonzero(chosen))
    frozen = np.repeat(chosen, lengths)
    frozen[first] = False  # that one was measured
    return frozen


def moving_speed(position: FloatArray) -> float:
    """Return the speed, rad (m) a sample, from which a joint counts as moving; 2 % of its peak.

    Infinite for a joint that never moves.
    """
    measured = position[np.isfinite(position)]
    span = max(2, min(20, len(measured) // 10))
    if len(measured) <= span:
        return np.inf
    speeds = np.abs(measured[span:] - measured[:-span]) / span
    peak = float(np.quantile(speeds, 0.99))
    return _MOVES * peak if peak > 0.0 else np.inf


def _is_isolated(lengths: IntArray, moved: BoolArray, chosen: IntArray) -> BoolArray:
    """Return whether each chosen run is much longer than the other runs around it, (k,) bool.

    `lengths`, `moved` (n,): of all runs; others count as far as the joint moves during them.
    """
    ends = np.cumsum(lengths)  # sample behind each run
    others = np.where(moved, lengths, 0)
    others[chosen] = 0
    around = _AROUND * lengths[chosen]
    begins = np.searchsorted(ends, ends[chosen] - lengths[chosen] - around)
    stops = np.searchsorted(ends, ends[chosen] + around) + 1
    longest = [others[begin:stop].max() for begin, stop in zip(begins, stops, strict=True)]
    return np.asarray(_LONGER * np.array(longest) <= lengths[chosen])


def _describe(channel: str, frozen: BoolArray, seconds: FloatArray) -> FrozenStretches:
    """Describe the frozen values (n,) bool of a channel at times `seconds` (n,)."""
    first, end = stretches_of(frozen)
    lengths = seconds[end - 1] - seconds[first - 1]
    samples = int(np.count_nonzero(frozen))
    begin, longest = float(seconds[first[0] - 1]), float(lengths.max())
    return FrozenStretches(channel, samples, samples / len(frozen), len(first), begin, longest)
