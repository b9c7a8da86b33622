"""Bootstrap over blocks of time: rows that follow one another are not independent."""

import numpy as np

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.types import FloatArray, IntArray

_SEED = 20240


def time_blocks(recordings: IntArray, places: IntArray, row_rate: float) -> IntArray:
    """Number the blocks of time of rows (r,): at least a second, at most 20 in a recording.

    Parameters
    ----------
    recordings, places
        (r,) which recording a row belongs to, and which decimated sample of it the row is.
    row_rate
        Decimated samples per second.
    """
    blocks = np.zeros(len(places), dtype=np.int64)
    first = 0
    for recording in np.unique(recordings):
        inside = recordings == recording
        place = places[inside] - places[inside].min()
        length = max(
            settings.LEAST_TIME_BLOCK * row_rate, (place.max() + 1) / settings.MOST_TIME_BLOCKS
        )
        number = (place / length).astype(np.int64)
        blocks[inside] = first + number
        first += int(number.max()) + 1
    return blocks


def block_sums(blocks: IntArray, values: FloatArray) -> FloatArray:
    """Sum of values (r,) in each block that has rows: (b,)."""
    _, number = np.unique(blocks, return_inverse=True)
    return np.asarray(np.bincount(number, weights=values), dtype=float)


def resampled(sums: FloatArray) -> FloatArray:
    """Sums over blocks drawn with replacement: (200, …) from (b, …).

    The draws are the same for the same number of blocks, so that differences are paired.
    """
    count = len(sums)
    draws = np.random.default_rng(_SEED).multinomial(
        count, np.full(count, 1.0 / count), size=settings.RESAMPLES
    )
    return np.asarray(np.tensordot(draws.astype(float), sums, axes=1))


def interval(values: FloatArray) -> tuple[float, float]:
    """95 % interval of resampled values (200,)."""
    low, high = np.quantile(values, [0.025, 0.975])
    return float(low), float(high)
