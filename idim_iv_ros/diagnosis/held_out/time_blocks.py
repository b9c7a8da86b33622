"""Bootstrap over blocks of time: rows that follow one another are not independent."""

import numpy as np

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.types import FloatArray, IntArray

_FEWEST_BLOCKS = 8  # in a short session: they are shorter then
_RESAMPLES = 1000  # of the bootstrap
_SEED = 20240


def time_blocks(
    recordings: IntArray, places: IntArray, row_rate: float, length: float | None = None
) -> IntArray:
    """Number the blocks of time of rows (r,): 5 s where the session has eight of them.

    In a shorter session they are shorter, at least a second; in a recording there are at most 20.

    Parameters
    ----------
    recordings, places
        (r,) which recording a row belongs to, and which decimated sample of it the row is.
    row_rate
        Decimated samples per second.
    length
        s, instead.
    """
    blocks = np.zeros(len(places), dtype=np.int64)
    inside = [recordings == recording for recording in np.unique(recordings)]
    lengths = [int(np.ptp(places[rows])) + 1 for rows in inside]
    whole = sum(lengths) / row_rate
    seconds = min(settings.TIME_BLOCK, whole / _FEWEST_BLOCKS)
    usual = (length or max(settings.LEAST_TIME_BLOCK, seconds)) * row_rate
    first = 0
    for rows, total in zip(inside, lengths, strict=True):
        # Equal parts: a short last block would count as much as the others when blocks are drawn.
        count = min(max(round(total / usual), 1), settings.MOST_TIME_BLOCKS)
        place = places[rows] - places[rows].min()
        blocks[rows] = first + np.minimum(place * count // total, count - 1)
        first += count
    return blocks


def block_sums(blocks: IntArray, values: FloatArray) -> FloatArray:
    """Sum of values (r,) in each block that has rows: (b,)."""
    _, number = np.unique(blocks, return_inverse=True)
    return np.asarray(np.bincount(number, weights=values), dtype=float)


def resampled(sums: FloatArray) -> FloatArray:
    """Sums over blocks drawn with replacement: (1000, …) from (b, …).

    The draws are the same for the same number of blocks, so that differences are paired.
    """
    count = len(sums)
    draws = np.random.default_rng(_SEED).multinomial(
        count, np.full(count, 1.0 / count), size=_RESAMPLES
    )
    return np.asarray(np.tensordot(draws.astype(float), sums, axes=1))


def interval(values: FloatArray) -> tuple[float, float]:
    """95 % interval of resampled values (1000,)."""
    low, high = np.quantile(values, [0.025, 0.975])
    return float(low), float(high)
