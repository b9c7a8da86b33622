"""The newest samples on a uniform grid that goes on for ever."""

import numpy as np
from scipy.interpolate import make_interp_spline

from idim_iv_ros.prediction.stream import JointSamples
from idim_iv_ros.recording.clock import GAP
from idim_iv_ros.recording.grid import Grid, on_grid
from idim_iv_ros.signals import JointTransform
from idim_iv_ros.types import BoolArray, FloatArray

# What a cubic spline between samples still changes so many samples from its end is below 1e-6.
_SPLINE = 12
_BEFORE = 0.12  # s before new samples, from which gaps are bridged with the speed at their edge


class LiveGrid:
    """Positions and torques of the joints at start + k / rate.

    Attributes
    ----------
    rate : float
        Hz.
    first, end : int
        Numbers k of the first sample that is kept, and behind the last one.
    position, torque : (end - first, n_joints)
        rad (m), N m (N).
    valid : (end - first, n_joints) bool
        Whether the joint's position and torque rest on measurements.
    """

    def __init__(self, rate: float, start: int, joints: int) -> None:
        self.rate, self._start = rate, start
        self.first = self.end = 0
        self.position: FloatArray = np.zeros((0, joints))
        self.torque: FloatArray = np.zeros((0, joints))
        self.valid: BoolArray = np.zeros((0, joints), dtype=bool)

    def stamp(self, place: int) -> int:
        """Time of a sample, ns."""
        return self._start + round(place * 1e9 / self.rate)

    @property
    def needed(self) -> int:
        """Stamp of the oldest sample that the next call needs, ns."""
        return self.stamp(self._context()) - round(2e9 * _BEFORE)

    def _context(self) -> int:
        return max(0, self.end - 2 * _SPLINE - round(_BEFORE * self.rate))

    def advance(
        self,
        positions: JointSamples,
        efforts: JointSamples,
        last: int,
        transform: JointTransform,
    ) -> None:
        """Put samples up to a stamp, ns, on the grid; the newest ones there are made anew."""
        begin = self._context()
        count = int((last - self.stamp(begin)) * 1e-9 * self.rate + 0.01) + 1
        if begin + count <= self.end:
            return
        grid = Grid(self.stamp(begin), self.rate, count)
        position, effort, invented_position, invented_effort = _both_on_grid(
            grid, positions, efforts
        )
        # The context is there for the splines and is kept as it was.
        fresh = max(self.end - _SPLINE, self.first, begin)
        new, kept = slice(fresh - begin, None), slice(0, fresh - self.first)
        invented = transform.touched(invented_position[new], invented_effort[new])
        self.position = np.concatenate([self.position[kept], transform.position(position[new])])
        self.torque = np.concatenate([self.torque[kept], transform.torque(effort[new])])
        self.valid = np.concatenate([self.valid[kept], ~invented])
        self.end = begin + count

    def forget(self, before: int) -> None:
        """Give up samples before number `before`."""
        surplus = before - self.first
        if surplus > 0:
            self.position, self.torque = self.position[surplus:], self.torque[surplus:]
            self.valid = self.valid[surplus:]
            self.first = before


def _both_on_grid(
    grid: Grid, positions: JointSamples, efforts: JointSamples
) -> tuple[FloatArray, FloatArray, BoolArray, BoolArray]:
    """Positions and efforts on the grid, and which of them nothing was measured for.

    As `recording.grid.on_grid`; without gaps all joints have one spline, a tenth of the work.
    """
    together = np.array_equal(positions.time, efforts.time)
    if together and _whole(grid, positions) and np.isfinite(efforts.values).all():
        seconds = (positions.time - grid.start) * 1e-9
        values = np.hstack([positions.values, efforts.values])
        spline = make_interp_spline(seconds, values, k=3)(grid.time)
        position, effort = np.hsplit(np.asarray(spline), 2)
        measured = np.zeros(position.shape, dtype=bool)
        return position, effort, measured, measured
    moved = on_grid(grid, positions.time, positions.values, "", smooth=True)
    driven = on_grid(grid, efforts.time, efforts.values, "")
    return moved.values, driven.values, moved.invented, driven.invented


def _whole(grid: Grid, samples: JointSamples) -> bool:
    """Whether all joints have numbers without gaps, around the whole grid."""
    if len(samples) <= _SPLINE or not np.isfinite(samples.values).all():
        return False
    steps = np.diff(samples.time) * 1e-9
    around = samples.time[0] <= grid.start
    return bool(around and steps.max() <= GAP * max(float(np.median(steps)), 1.0 / grid.rate))
