"""Which columns of a matrix are independent of those before them."""

import numpy as np

from idim_iv_ros.types import FloatArray, IntArray


def independent_columns(columns: FloatArray, tolerance: float) -> tuple[IntArray, FloatArray]:
    """Eliminate the columns that those before them explain: Gram-Schmidt without pivoting.

    One pass over the columns, however many depend on others.

    Parameters
    ----------
    columns
        (r, c) of norm one, or zero.
    tolerance
        Norm that is left of a column when it counts.

    Returns
    -------
    kept : (rank,) int, increasing
    basis : (r, rank)
        Orthonormal, of the span of the columns that are kept.
    """
    rows, count = columns.shape
    basis = np.empty((rows, min(rows, count)), order="F")
    kept: list[int] = []
    for column in range(count):
        direction, known = columns[:, column], basis[:, : len(kept)]
        for _ in range(2):  # twice is enough for orthogonality to rounding
            direction = direction - known @ (known.T @ direction)
        left = float(np.linalg.norm(direction))
        if left > tolerance and len(kept) < basis.shape[1]:
            basis[:, len(kept)] = direction / left
            kept.append(column)
    return np.array(kept, dtype=np.int64), basis[:, : len(kept)]
