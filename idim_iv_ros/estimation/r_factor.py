"""The R factor of tall rows, which stands for them in least squares, and its joint's columns."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from idim_iv_ros.types import FloatArray

IntArray = NDArray[np.integer[Any]]


def r_factor(rows: FloatArray) -> FloatArray:
    """R of the QR of `rows` (r, k): every sum of squares and products of the columns is kept."""
    return np.asarray(np.linalg.qr(rows, mode="r"), dtype=np.float64)


def spread(rows: FloatArray, places: IntArray, width: int) -> FloatArray:
    """Put the columns of one joint at their `places` among `width` columns; zero elsewhere."""
    wide = np.zeros((len(rows), width))
    wide[:, places] = rows
    return wide
