"""Joint positions that a driver wraps into one turn (±π, or 0 … 2π) are made continuous again.

A wrap is a step of nearly a whole turn between two samples of a signal that never leaves one turn;
with the turn removed, the step is no longer than the steps around it. A real jump fails that.
Torques depend on the position of a revolute joint only up to whole turns, so that a turn that
cannot be known (the joint turned in a gap) changes no result: the nearest one is taken.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import maximum_filter

from idim_iv_ros.recording.bags.joint_messages import JointMessages
from idim_iv_ros.recording.clock import GAP
from idim_iv_ros.recording.recording import Note
from idim_iv_ros.types import FloatArray, IntArray

TURN = 2.0 * np.pi
_ONE_TURN = TURN * (1.0 + 1e-3)  # drivers round their limits
# Without its turn a wrap is at most this many times the largest step of those around it, plus the
# noise of a position at rest, rad; and never more than a quarter of a turn.
_PLAUSIBLE, _AROUND, _NOISE = 3.0, 10, 2e-3
_LARGEST = TURN / 4.0
# A reference that is within this of whole turns from the position is off by these turns, rad.
_WHOLE = 0.5


@dataclass(frozen=True)
class Unwrapped:
    """A position without wraps."""

    position: FloatArray  # (n,), rad
    wraps: int  # how many were removed
    breaks: IntArray  # (k,), samples behind gaps, from which on the number of turns is a guess


def without_wraps(
    stamped: Mapping[str, JointMessages],
    joint_states: str,
    followers: Sequence[str],
    joints: Sequence[str],
    sliding: Collection[str],
) -> dict[str, JointMessages]:
    """Remove the wraps of positions, and bring references and link positions to the same turn.

    `stamped`: messages of each topic. `joint_states`, `followers`: topics of the positions, and of
    references or encoders behind the gears. `sliding`: prismatic joints, which have no turns.
    """
    new, states = dict(stamped), stamped[joint_states]
    for column, joint in enumerate(joints):
        if joint in sliding:
            continue
        position = unwrapped(states.stamps, states.values["position"][:, column])
        if position.wraps:
            new[joint_states] = _with_positions(new[joint_states], column, joint, position)
        for follower in followers if np.isfinite(position.position).any() else ():
            topic = new[follower]
            reference = unwrapped(topic.stamps, topic.values["position"][:, column])
            if follower == joint_states or not np.isfinite(reference.position).any():
                continue
            turns = _turns_between(states.stamps, position, topic.stamps, reference)
            if reference.wraps or turns.any():
                whole = replace(reference, position=reference.position + TURN * turns)
                new[follower] = _with_positions(topic, column, joint, whole)
    return new


def unwrapped(time: IntArray, position: FloatArray) -> Unwrapped:
    """Remove the wraps of a position (n,) rad at stamps `time` (n,) ns."""
    unchanged = Unwrapped(position, 0, np.zeros(0, np.int64))
    finite = np.flatnonzero(np.isfinite(position))
    measured = position[finite]
    # Without a copy, so that the many joints that never wrap cost nothing.
    if len(measured) < 2 or not TURN - _LARGEST <= measured.max() - measured.min() <= _ONE_TURN:
        return unchanged
    steps = np.diff(measured)
    turns = np.round(steps / TURN)
    if not turns.any():
        return unchanged
    interval = np.diff(time[finite]) * 1e-9
    short = steps - TURN * turns
    speed = np.abs(short) / interval
    around = np.ones(2 * _AROUND + 1, dtype=bool)
    around[_AROUND] = False  # without the step itself
    fastest = maximum_filter(speed, footprint=around, mode="constant")
    allowed = _PLAUSIBLE * fastest * interval + _NOISE
    plausible = np.abs(short) <= np.minimum(allowed, _LARGEST)
    wraps = (turns != 0.0) & plausible
    if not wraps.any():
        return unchanged
    unsure = (interval > GAP * float(np.median(interval))) & (np.abs(steps) > _LARGEST)
    whole = position.copy()
    whole[finite[1:]] -= TURN * np.cumsum(np.where(wraps | unsure, turns, 0.0))
    return Unwrapped(whole, int(np.count_nonzero(wraps)), finite[1:][unsure])


def _turns_between(
    time: IntArray, position: Unwrapped, reference_time: IntArray, reference: Unwrapped
) -> FloatArray:
    """Return whole turns (n,) to add to a reference to follow its position, by segment."""
    finite = np.isfinite(position.position)
    start = time[0]
    positions = np.interp(reference_time - start, (time - start)[finite], position.position[finite])
    ahead = positions - reference.position
    turns = np.zeros(len(reference_time))
    behind = np.searchsorted(reference_time, time[position.breaks])
    cuts = np.unique(np.concatenate([behind, reference.breaks]))
    for stretch in np.split(np.arange(len(turns)), cuts):
        ahead_here = ahead[stretch][np.isfinite(ahead[stretch])]
        if len(ahead_here) == 0:
            continue
        middle = float(np.median(ahead_here))
        nearest = round(middle / TURN)
        if position.wraps or reference.wraps or abs(middle - TURN * nearest) < _WHOLE:
            turns[stretch] = nearest
    return turns


def _with_positions(
    stamped: JointMessages, column: int, joint: str, position: Unwrapped
) -> JointMessages:
    values = stamped.values["position"].copy()
    values[:, column] = position.position
    times = "once" if position.wraps == 1 else f"{position.wraps} times"
    sentence = f"position of {joint} wraps after one turn ({times}): unwrapped"
    if not position.wraps:
        sentence = f"the reference of {joint} is put into the same turn as its position"
    return stamped.with_values("position", values, Note(stamped.topic, sentence, 1))
