"""RMS of a residual and its interval, by a bootstrap over blocks of time.

Rows that follow one another are not independent: whole blocks of them are drawn.
"""

from functools import lru_cache

import numpy as np

from idim_iv_ros.types import FloatArray, IntArray

_RESAMPLES = 1000
_SEED = 20240


def block_sums(blocks: IntArray, values: FloatArray) -> FloatArray:
    """Sum of values (r, …) in each block that has rows, one after the other: (b, …)."""
    _, first = np.unique(blocks, return_index=True)
    return np.asarray(np.add.reduceat(values, first, axis=0))


def energies(residuals: FloatArray, blocks: IntArray) -> FloatArray:
    """Sums of squares of residuals (r,) or (r, n), and of rows, in each block (r,): (b, n + 1)."""
    return block_sums(blocks, np.column_stack([residuals**2, np.ones(len(residuals))]))


def roots(sums: FloatArray) -> FloatArray:
    """RMS (…, n) from sums of squares and of rows, or seconds, (…, n + 1)."""
    return np.asarray(np.sqrt(sums[..., :-1] / np.maximum(sums[..., -1:], 1e-300)))


def resampled(sums: FloatArray) -> FloatArray:
    """Sums over blocks drawn with replacement: (1000, …) from (b, …).

    The draws are the same for the same number of blocks, so that differences are paired.
    """
    return np.asarray(np.tensordot(_draws(len(sums)), sums, axes=1))


@lru_cache(maxsize=4)
def _draws(count: int) -> FloatArray:
    """How often each of some blocks is drawn, (1000, count)."""
    every = np.full(count, 1.0 / count)
    return np.random.default_rng(_SEED).multinomial(count, every, size=_RESAMPLES).astype(float)


def interval(values: FloatArray) -> tuple[float, float]:
    """95 % interval of resampled values (1000,)."""
    low, high = np.quantile(values, [0.025, 0.975])
    return float(low), float(high)
