"""Samples as they arrive, put in the order of time, without wraps; faulty clocks are detected."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from idim_iv_ros.recording.grid import make_grid
from idim_iv_ros.recording.wraps import TURN
from idim_iv_ros.types import BoolArray, FloatArray, IntArray

_SECOND = 1e9
NEVER = np.iinfo(np.int64).min
_LONGEST_PAUSE = 1.0  # s
_MOST = 5_000_000_000  # ns of samples that are kept at most
# A stamp further back than so many intervals, s at least: the clock was set back.
_SET_BACK, _SET_BACK_INTERVALS = 0.1, 20.0
_WRAP = 0.75 * TURN  # a longer step between two positions is a wrap
# Time and samples at least, from which a rate is measured.
_LEAST, _LEAST_SAMPLES = 0.5, 20
# Steps whose median tells whether the rate has changed, and by how much, as a ratio.
_RECENT, _OTHER_RATE = 60, 1.3


@dataclass(frozen=True)
class JointSamples:
    """Stamped values of all joints."""

    time: IntArray  # (n,) int: ns
    values: FloatArray  # (n, n_joints): NaN where a joint has none
    # (n, n_joints): joints that each sample is about; None where every sample is about all of them
    named: BoolArray | None = None

    def __len__(self) -> int:
        return len(self.time)

    @property
    def about(self) -> BoolArray:
        """Return the joints that each sample has values of, (n, n_joints) bool."""
        return np.ones(self.values.shape, dtype=bool) if self.named is None else self.named

    @property
    def newest(self) -> IntArray:
        """Return the newest stamp of each joint, (n_joints,) ns; `NEVER` without one."""
        stamps = np.where(self.about, self.time[:, None], NEVER)
        return np.asarray(stamps.max(axis=0, initial=NEVER))

    @property
    def slowest(self) -> IntArray:
        """Return the stamps, ns, of the joint with the fewest samples."""
        counts = self.about.sum(axis=0)
        column = int(np.argmin(np.where(counts > 0, counts, len(self) + 1)))
        return np.asarray(self.time[self.about[:, column]])

    def followed_by(self, later: "JointSamples") -> "JointSamples":
        """Return these and later samples in the order of time; equal stamps are merged."""
        times, place = np.unique(np.concatenate([self.time, later.time]), return_inverse=True)
        row, column = np.nonzero(np.concatenate([self.about, later.about]))
        values = np.concatenate([self.values, later.values])
        merged = np.full((len(times), values.shape[1]), np.nan)
        named = np.zeros(merged.shape, dtype=bool)
        merged[place[row], column], named[place[row], column] = values[row, column], True
        return JointSamples(times, merged, named)

    def part(self, rows: slice) -> "JointSamples":
        """Return a slice of the samples."""
        return JointSamples(self.time[rows], self.values[rows], self.about[rows])


class SampleStream:
    """The newest samples of one topic, whose quantity is `name`: ``position`` or ``effort``.

    `turning` (n_joints,) are positions that may wrap after one turn.
    """

    def __init__(self, name: str, turning: Sequence[bool]) -> None:
        self.name, self._turning = name, np.array(turning, dtype=bool)
        self._empty = JointSamples(np.zeros(0, np.int64), np.zeros((0, len(turning))))
        self.samples = self._empty
        self.restarted = ""  # why the last `add` dropped older samples: a pause, a clock
        self.late = 0  # samples left out because their stamps do not increase
        self.arrived = 0  # time of the last change of `reached`, ns
        self.rate: float | None = None  # of sampling, Hz; None until `measure_rate`

    def add(self, new: JointSamples, now: int) -> None:
        """Append samples in the order of their arrival, at time `now`, ns."""
        self.restarted = ""
        if len(new) == 0:
            return
        time, first, before = new.time, 0, self.reached
        if len(self.samples):
            time = np.concatenate([self.samples.time[-1:], time])
        steps = np.diff(time) / _SECOND
        back = -max(_SET_BACK, _SET_BACK_INTERVALS * (self.interval or 0.0))
        breaks = np.flatnonzero((steps < back) | (steps > _LONGEST_PAUSE))
        if len(breaks):
            # The last of them counts: what comes after it is one stretch.
            step = float(steps[breaks[-1]])
            jump = f"the stamps jump back by {-step:.3g} s"
            self.restarted = jump if step < 0.0 else f"no sample for {step:.3g} s"
            first = len(new) - (len(time) - 1 - int(breaks[-1]))
            self.clear()
        self._append(new.part(slice(first, None)))
        if self.reached != before:
            self.arrived = now
        self.forget(int(self.samples.time[-1]) - _MOST)

    def _append(self, new: JointSamples) -> None:
        stamps = np.vstack([self.samples.newest, np.where(new.about, new.time[:, None], NEVER)])
        about = new.about & (new.time[:, None] > np.maximum.accumulate(stamps)[:-1])
        fresh = about.any(axis=1)
        self.late += int(np.count_nonzero(~fresh))
        values = np.where(about, new.values, np.nan)[fresh]
        self.samples = self.samples.followed_by(JointSamples(new.time[fresh], values, about[fresh]))
        positions = self.samples.values
        for joint in np.flatnonzero(self._turning):
            measured = np.isfinite(positions[:, joint])
            positions[measured, joint] = np.unwrap(positions[measured, joint], discont=_WRAP)

    def forget(self, before: int) -> None:
        """Drop samples stamped before a time, ns, except the last one."""
        first = min(int(np.searchsorted(self.samples.time, before)), max(len(self.samples) - 1, 0))
        self.samples = self.samples.part(slice(first, None))

    def clear(self) -> None:
        """Drop all samples."""
        self.samples = self._empty

    @property
    def interval(self) -> float | None:
        """Return the median of the recent sampling intervals, s; None below two samples."""
        recent = self.samples.slowest[-_RECENT:]
        return float(np.median(np.diff(recent))) / _SECOND if len(recent) > 1 else None

    @property
    def reached(self) -> int:
        """Return the stamp up to which all joints have samples, ns; `NEVER` without any."""
        newest = self.samples.newest
        return int(np.min(newest, where=newest > NEVER, initial=np.max(newest, initial=NEVER)))

    def measure_rate(self) -> float | None:
        """Return the rate of all samples, Hz, as for a recording; None while they are few."""
        time = self.samples.slowest
        enough = len(time) >= _LEAST_SAMPLES and time[-1] - time[0] >= _LEAST * _SECOND
        self.rate = make_grid(time, int(time[0]), int(time[-1])).rate if enough else None
        return self.rate

    @property
    def other_rate(self) -> float | None:
        """Return the rate of the recent samples, Hz, if it has changed; else None."""
        if len(self.samples.slowest) < _RECENT or self.interval is None or self.rate is None:
            return None
        same = 1.0 / _OTHER_RATE < self.interval * self.rate < _OTHER_RATE
        return None if same else 1.0 / (self.interval or 1.0)

    @property
    def missing(self) -> BoolArray:
        """Return the joints (n_joints,) bool without a finite value in the samples kept."""
        return np.asarray(~np.isfinite(self.samples.values).any(axis=0))
