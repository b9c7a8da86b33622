"""Pauses of a recording: nothing is computed, and no memory is taken, for most of a long one."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from idim_iv_ros.recording.clock import StampedMessages, selected
from idim_iv_ros.recording.recording import Note
from idim_iv_ros.types import IntArray

# A longer step without a message is shortened to this, s: time for a joint to be elsewhere after it
# without having to be fast, and short beside the memory that a recording takes anyway.
LONGEST_PAUSE = 10.0


@dataclass(frozen=True)
class Pauses:
    """What is cut out of time.

    Attributes
    ----------
    begin, end : (k,) int
        Of each cut, ns.
    """

    begin: IntArray
    end: IntArray

    def kept(self, time: IntArray) -> NDArray[np.bool_]:
        """Whether each of the sorted stamps `time` (n,) lies outside all cuts."""
        pause = np.searchsorted(self.begin, time, side="right") - 1
        inside = (pause >= 0) & (time < self.end[np.maximum(pause, 0)])
        return np.asarray(~inside)

    def shortened(self, time: IntArray) -> IntArray:
        """Stamps (n,) without the time that was cut out before each."""
        removed = np.concatenate([[0], np.cumsum(self.end - self.begin)])
        return np.asarray(time - removed[np.searchsorted(self.end, time, side="right")])


def without_pauses(
    stamped: Mapping[str, StampedMessages], joint_states: str
) -> dict[str, StampedMessages]:
    """Shorten long pauses of the joint states, for all topics alike, and say so."""
    time = stamped[joint_states].time
    steps = np.diff(time)
    shortest = max(round(LONGEST_PAUSE * 1e9), 3 * int(np.median(steps)))
    long = np.flatnonzero(steps > shortest)
    if len(long) == 0:
        return dict(stamped)
    pauses = Pauses(time[long] + shortest, time[long + 1])
    removed = float((pauses.end - pauses.begin).sum()) * 1e-9
    longest = float(steps[long].max()) * 1e-9
    first = float(time[long[0]] - time[0]) * 1e-9
    count = "a pause" if len(long) == 1 else f"{len(long)} pauses, the longest"
    what = (
        f"{count} of {longest:.4g} s, first {first:.4g} s after the start: {shortest * 1e-9:g} s "
        f"of each are kept, so that later times of this recording are up to {removed:.4g} s early"
    )
    shortened = {}
    for topic, messages in stamped.items():
        inside = pauses.kept(messages.time)
        kept = messages if inside.all() else selected(messages, np.flatnonzero(inside))
        notes = (*kept.notes, Note(topic, what, 1, limits=True)) if topic == joint_states else ()
        shortened[topic] = replace(
            kept, time=pauses.shortened(kept.time), notes=notes or kept.notes
        )
    return shortened
