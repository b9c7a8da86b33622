"""Samples as they arrive: in the order of time, without wraps; faults of the clock are found."""

from dataclasses import dataclass

import numpy as np

from idim_iv_ros.recording.grid import make_grid
from idim_iv_ros.recording.wraps import TURN
from idim_iv_ros.types import BoolArray, FloatArray, IntArray

_SECOND = 1e9
NEVER = np.iinfo(np.int64).min
# A stamp further back than so many intervals, s at least: the clock was set back.
_SET_BACK, _SET_BACK_INTERVALS = 0.1, 20.0
_WRAP = 0.75 * TURN  # a longer step between two positions is a wrap
# Time and samples at least, from which a rate is measured.
_LEAST, _LEAST_SAMPLES = 0.5, 20
# Steps whose median tells whether the rate has changed, and by how much, as a ratio.
_RECENT, _OTHER_RATE = 60, 1.3


@dataclass(frozen=True)
class JointSamples:
    """Stamped numbers of all joints."""

    time: IntArray  # (n,) int: ns
    values: FloatArray  # (n, n_joints): NaN where a joint has none
    # (n, n_joints) bool or None: Joints that each sample is about, where parts of the robot
    # have messages of their own; None where every sample is about all of them
    named: BoolArray | None = None

    def __len__(self) -> int:
        return len(self.time)

    @property
    def about(self) -> BoolArray:
        """Joints that each sample is about, (n, n_joints) bool."""
        return np.ones(self.values.shape, dtype=bool) if self.named is None else self.named

    @property
    def newest(self) -> IntArray:
        """Newest stamp of each joint, (n_joints,) ns; `NEVER` without one."""
        stamps = np.where(self.about, self.time[:, None], NEVER)
        return np.asarray(stamps.max(axis=0, initial=NEVER))

    @property
    def slowest(self) -> IntArray:
        """Stamps, ns, of the joint that has the fewest."""
        counts = self.about.sum(axis=0)
        column = int(np.argmin(np.where(counts > 0, counts, len(self) + 1)))
        return np.asarray(self.time[self.about[:, column]])

    def followed_by(self, later: "JointSamples") -> "JointSamples":
        """These and later ones in the order of time, samples of one stamp put together."""
        values = np.concatenate([self.values, later.values])
        about = np.concatenate([self.about, later.about])
        times, place = np.unique(np.concatenate([self.time, later.time]), return_inverse=True)
        row, column = np.nonzero(about)
        merged = np.full((len(times), values.shape[1]), np.nan)
        merged[place[row], column] = values[row, column]
        named = np.zeros(merged.shape, dtype=bool)
        named[place[row], column] = True
        return JointSamples(times, merged, named)

    def part(self, rows: slice) -> "JointSamples":
        """Some of the samples."""
        return JointSamples(self.time[rows], self.values[rows], self.about[rows])


class SampleStream:
    """The newest samples of one topic.

    - `turning`: (n_joints,), whose values are positions that may wrap after one turn
    - `longest_pause`: s; after a longer one, or a clock that was set, everything begins anew

    - `restarted`: why everything older was given up with the last samples that were added; else
      empty
    - `late`: samples that were left out since their stamp is not after the one before of their
      joints
    """

    def __init__(self, turning: tuple[bool, ...], longest_pause: float) -> None:
        self._turning = np.array(turning, dtype=bool)
        self._longest_pause = longest_pause
        self._empty = JointSamples(np.zeros(0, np.int64), np.zeros((0, len(turning))))
        self.samples = self._empty
        self.restarted = ""
        self.late = 0

    def add(self, new: JointSamples) -> None:
        """Append samples in the order of their arrival."""
        self.restarted = ""
        if len(new) == 0:
            return
        time, first = new.time, 0
        if len(self.samples):
            time = np.concatenate([self.samples.time[-1:], time])
        steps = np.diff(time) / _SECOND
        interval = self.interval or 0.0
        back = -max(_SET_BACK, _SET_BACK_INTERVALS * interval)
        breaks = np.flatnonzero((steps < back) | (steps > self._longest_pause))
        if len(breaks):
            # The last of them counts: what comes after it is one stretch.
            step = float(steps[breaks[-1]])
            self.restarted = (
                f"the stamps jump back by {-step:.3g} s"
                if step < 0.0
                else f"no sample for {step:.3g} s"
            )
            first = len(new) - (len(time) - 1 - int(breaks[-1]))
            self.samples = self._empty
        self._append(new.part(slice(first, None)))

    def _append(self, new: JointSamples) -> None:
        """Append samples that are later than those of their joints, without wraps."""
        stamps = np.vstack([self.samples.newest, np.where(new.about, new.time[:, None], NEVER)])
        about = new.about & (new.time[:, None] > np.maximum.accumulate(stamps)[:-1])
        fresh = about.any(axis=1)
        self.late += int(np.count_nonzero(~fresh))
        later = JointSamples(
            new.time[fresh], np.where(about, new.values, np.nan)[fresh], about[fresh]
        )
        self.samples = self.samples.followed_by(later)
        positions = self.samples.values
        for joint in np.flatnonzero(self._turning):
            measured = np.isfinite(positions[:, joint])
            positions[measured, joint] = np.unwrap(positions[measured, joint], discont=_WRAP)

    def forget(self, before: int) -> None:
        """Give up samples stamped before a time, ns, but the last one."""
        first = min(int(np.searchsorted(self.samples.time, before)), max(len(self.samples) - 1, 0))
        self.samples = self.samples.part(slice(first, None))

    def clear(self) -> None:
        """Give up all samples."""
        self.samples = self._empty

    @property
    def interval(self) -> float | None:
        """Median of the recent sampling intervals, s; None for fewer than two samples."""
        recent = self.samples.slowest[-_RECENT:]
        return float(np.median(np.diff(recent))) / _SECOND if len(recent) > 1 else None

    @property
    def reached(self) -> int:
        """Stamp up to which every joint that has samples has them, ns; `NEVER` without any."""
        newest = self.samples.newest
        return int(np.min(newest, where=newest > NEVER, initial=np.max(newest, initial=NEVER)))

    def rate(self) -> float | None:
        """Rate of all samples, Hz, as a recording's; None while they are too few."""
        time = self.samples.slowest
        if len(time) < _LEAST_SAMPLES or time[-1] - time[0] < _LEAST * _SECOND:
            return None
        return make_grid(time, int(time[0]), int(time[-1])).rate

    def has_other_rate(self, rate: float) -> bool:
        """Whether the recent samples came at another rate, Hz."""
        recent = self.samples.slowest[-_RECENT:]
        if len(recent) < _RECENT or self.interval is None:
            return False
        ratio = self.interval * rate
        return not 1.0 / _OTHER_RATE < ratio < _OTHER_RATE

    def missing(self) -> BoolArray:
        """Joints (n_joints,) without any number in all samples that are kept."""
        return np.asarray(~np.isfinite(self.samples.values).any(axis=0))
