"""The mean of a residual over scattered samples, with its interval."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from idim_iv_ros.types import FloatArray

_CELLS = 180
_WIDTH = _CELLS / 32.0  # σ of the kernel, cells
_BLOCK = 1.5  # s; longer than what a filtered residual remembers
_FEWEST_BLOCKS, _MOST_BLOCKS = 4, 80
_FEWEST_ROWS = 8.0


@dataclass(frozen=True)
class SmoothCurve:
    """Mean of y over x, NaN where too few samples are near; (g,) each.

    `low`, `high`: 95 % interval of the mean, from blocks of time, so that neighbouring samples
    do not count as independent.
    """

    x: FloatArray
    mean: FloatArray
    low: FloatArray
    high: FloatArray


def smooth(x: FloatArray, y: FloatArray, time: FloatArray) -> SmoothCurve:
    """Smooth y over x with a Gaussian kernel of a thirtieth of the range.

    The standard error of the ratio m = Σ_b S_b / Σ_b N_b of kernel sums over blocks b is
    √(B/(B−1) Σ_b (S_b − m N_b)²) / Σ_b N_b.

    `x`, `y`, `time` (r,): abscissa (in the scale that is drawn), ordinate, and the increasing time
    of the session, s.
    """
    # Between the outermost half percents.
    low, high = np.percentile(x, [0.5, 99.5]) if len(x) else (0.0, 0.0)
    if not high > low:
        return SmoothCurve(*[np.zeros(0)] * 4)
    edges = np.linspace(low, high, _CELLS + 1)
    grid = 0.5 * (edges[1:] + edges[:-1])
    cell = np.clip(np.searchsorted(edges, x, side="right") - 1, 0, _CELLS - 1)
    block = _blocks(time)
    place = block * _CELLS + cell
    shape = (int(block.max()) + 1, _CELLS)
    size = shape[0] * _CELLS
    counts, sums = (np.bincount(place, of, size).reshape(shape) for of in (None, y))
    # A kernel with unit height, so that counts stay numbers of rows.
    height = _WIDTH * np.sqrt(2.0 * np.pi)
    near, total = (
        height * gaussian_filter1d(of.astype(float), _WIDTH, axis=1, mode="constant")
        for of in (counts, sums)
    )
    rows = near.sum(axis=0)
    enough = rows >= _FEWEST_ROWS
    safe = np.where(enough, rows, 1.0)
    mean = np.where(enough, total.sum(axis=0) / safe, np.nan)
    visits = (near >= 0.5).sum(axis=0)
    spread = np.sum((total - mean * near) ** 2, axis=0)
    error = np.sqrt(visits / np.maximum(visits - 1, 1) * spread) / safe
    error[visits < _FEWEST_BLOCKS] = np.nan
    return SmoothCurve(grid, mean, mean - 1.96 * error, mean + 1.96 * error)


def _blocks(time: FloatArray) -> NDArray[np.int64]:
    """Number the blocks of about equal time, in which pauses between recordings do not count."""
    steps = np.clip(np.diff(time), 0.0, _BLOCK)
    elapsed = np.concatenate([[0.0], np.cumsum(steps)])
    span = max(float(elapsed[-1]), 1e-9)
    count = int(np.clip(span / _BLOCK, _FEWEST_BLOCKS, _MOST_BLOCKS))
    block = np.floor(elapsed / span * count)
    return np.asarray(np.minimum(block, count - 1), dtype=np.int64)
