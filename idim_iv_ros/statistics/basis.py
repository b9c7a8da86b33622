"""Least squares on an orthonormal basis of the columns, with the rank judged."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from idim_iv_ros.types import FloatArray

IntArray = NDArray[np.integer[Any]]

RANK_TOLERANCE = 1e-8


@dataclass(frozen=True)
class Basis:
    """An orthonormal basis of the span of columns, and which of them it is made of.

    Attributes
    ----------
    vectors : (k, rank)
    kept : (rank,) int
        The columns that carry the span; the others depend on them.
    upper : (rank, rank)
        vectors @ upper = columns[:, kept].
    """

    vectors: FloatArray
    kept: IntArray
    upper: FloatArray

    @property
    def rank(self) -> int:
        """How many columns are independent."""
        return len(self.kept)

    def solve(self, target: FloatArray, width: int) -> FloatArray:
        """Coefficients (width,) or (width, m) of least squares, zero for dropped columns."""
        coefficients = np.zeros((width, *target.shape[1:]))
        if self.rank:
            coefficients[self.kept] = scipy.linalg.solve_triangular(
                self.upper, self.vectors.T @ target
            )
        return coefficients

    def inverse_root(self, width: int) -> FloatArray:
        """(width, rank) G with G Gᵀ = (columnsᵀ columns)⁻¹ on the kept columns, zero elsewhere."""
        root = np.zeros((width, self.rank))
        if self.rank:
            root[self.kept] = scipy.linalg.solve_triangular(self.upper, np.eye(self.rank))
        return root

    def remove(self, target: FloatArray) -> FloatArray:
        """Return what of `target` the span does not explain."""
        rest = target - self.vectors @ (self.vectors.T @ target)
        # Once more: after one pass a nearly collinear target keeps a part of the span.
        cleaned: FloatArray = rest - self.vectors @ (self.vectors.T @ rest)
        return cleaned


def independent_basis(columns: FloatArray, scale: FloatArray | None = None) -> Basis:
    """Basis of the span of `columns` (k, c) by pivoted QR, each column scaled first.

    A column counts when |R_ii| > 1e-8 relative to its `scale`, by default its own norm, so
    that the decision does not depend on units.
    """
    norms = np.linalg.norm(columns, axis=0) if scale is None else scale
    present = np.flatnonzero(norms > 0.0)
    if len(present) == 0 or len(columns) == 0:
        return Basis(np.zeros((len(columns), 0)), np.zeros(0, np.intp), np.zeros((0, 0)))
    vectors, upper, order = scipy.linalg.qr(
        columns[:, present] / norms[present], mode="economic", pivoting=True
    )
    rank = int(np.count_nonzero(np.abs(np.diag(upper)) > RANK_TOLERANCE))
    kept = present[order[:rank]]
    return Basis(vectors[:, :rank], kept, upper[:rank, :rank] * norms[kept])
