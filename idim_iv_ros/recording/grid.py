"""One uniform time grid for all signals of a bag."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from idim_iv_ros.recording.bridge import bridged
from idim_iv_ros.recording.clock import GAP
from idim_iv_ros.recording.recording import Signal
from idim_iv_ros.types import FloatArray, IntArray

# Stamps this close to the grid (share of an interval) lie on it.
_ON_GRID = 1e-3
# A rounded rate may drift by this share of a sample over the recording.
_DRIFT = 0.25


@dataclass(frozen=True)
class Grid:
    """Sample k is at start + k / rate.

    Attributes
    ----------
    start : int
        ns.
    rate : float
        Hz.
    samples : int
    """

    start: int
    rate: float
    samples: int

    @property
    def time(self) -> FloatArray:
        """Times of the samples from the start, (n_samples,) s."""
        return np.arange(self.samples) / self.rate


def make_grid(time: IntArray, first: int, last: int) -> Grid:
    """Grid at the rate of `time` (n,) ns, from its first stamp in `first` … `last`.

    The rate is the mean one, gaps allowed for; a whole number of Hz where that changes nothing.
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
    samples = int((last - start) * 1e-9 * rate + 0.01) + 1
    return Grid(start, rate, samples)


def on_grid(
    grid: Grid, time: IntArray, values: FloatArray, origin: str, *, smooth: bool = False
) -> Signal:
    """Values (n, n_joints) at stamps `time` (n,) ns, linearly between stamps on the grid.

    Stamps that lie on the grid give their values bit for bit. A sample is invented when the stamps
    around it are further apart than a gap, or where its value is not finite; `smooth` ones have no
    corners there (see `bridged`).
    """
    seconds: FloatArray = (time - grid.start).astype(np.float64) * 1e-9
    median = float(np.median(np.diff(time))) * 1e-9 if len(time) > 1 else 1.0 / grid.rate
    if _lies_on(grid, seconds):
        first = round(float(seconds[0]) * grid.rate)
        direct = values[-first : grid.samples - first] if first <= 0 else None
        if direct is not None and len(direct) == grid.samples:
            invented = ~np.isfinite(direct)
            if not invented.any():
                return Signal(_frozen(direct), _frozen(invented), origin)
    target = grid.time
    out = np.empty((grid.samples, values.shape[1]))
    invented = np.empty((grid.samples, values.shape[1]), dtype=bool)
    for joint in range(values.shape[1]):
        finite = np.isfinite(values[:, joint])
        known = seconds[finite]
        if len(known) == 0:
            out[:, joint], invented[:, joint] = 0.0, True
            continue
        out[:, joint] = np.interp(target, known, values[finite, joint])
        invented[:, joint] = _unsupported(target, known, GAP * max(median, 1.0 / grid.rate))
        if smooth:
            bridged(out[:, joint], invented[:, joint], grid.rate)
    return Signal(_frozen(out), _frozen(invented), origin)


def _lies_on(grid: Grid, seconds: FloatArray) -> bool:
    """Whether the stamps are consecutive samples of the grid."""
    place = seconds * grid.rate
    first = round(float(place[0]))
    return bool(np.all(np.abs(place - first - np.arange(len(place))) < _ON_GRID))


def _unsupported(target: FloatArray, known: FloatArray, gap: float) -> NDArray[np.bool_]:
    after = np.searchsorted(known, target, side="left")
    before = np.clip(after - 1, 0, len(known) - 1)
    after = np.clip(after, 0, len(known) - 1)
    nearest = np.minimum(np.abs(target - known[before]), np.abs(known[after] - target))
    wide = (known[after] - known[before]) > gap
    outside = (target < known[0]) | (target > known[-1])
    exact = nearest < 1e-3 * gap
    return np.asarray((wide & ~exact) | (outside & (nearest > gap)))


def _frozen(array: NDArray[Any]) -> NDArray[Any]:
    array.setflags(write=False)
    return array
