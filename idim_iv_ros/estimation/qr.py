"""Least squares by QR: the R factor of tall rows, and which of their columns are independent.

Normal equations XᵀX are never formed: they square the condition number. Every fit goes through
the R factor instead, which keeps all sums of squares and products of the columns. Columns that
depend on others are dropped; nothing is added to a diagonal.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from idim_iv_ros.model.base_parameters import independent_columns
from idim_iv_ros.types import FloatArray, IntArray

# A column depends on those before it when less than this share of its norm is independent of
# them: rounding of filtered columns is 1e-12, the smallest signal of an encoder 1e-6.
ROUNDING = 1e-8
# The same where it is judged whether a recording shows a parameter or an effect.
NOT_SHOWN = 1e-6
BLOCK = 2000  # rows that are reduced at once


def r_factor(rows: FloatArray) -> FloatArray:
    """R (≤ k, k) of the QR of `rows` (r, k): RᵀR = rowsᵀ rows, without forming either."""
    blocks = (rows[start : start + BLOCK] for start in range(0, len(rows), BLOCK))
    return streamed_r_factor(blocks, rows.shape[1])


def streamed_r_factor(blocks: Iterable[FloatArray], width: int) -> FloatArray:
    """R factor of blocks (r_i, width) one below the other, each forgotten when it is reduced."""
    factor = np.zeros((0, width))
    for block in blocks:
        rows = np.vstack([factor, block]) if len(factor) else np.asarray(block, dtype=np.float64)
        if rows.size:
            factored = scipy.linalg.lapack.dgeqrf(rows, lwork=64 * width)[0]
            factor = np.asarray(np.triu(factored[:width]))
    return factor


def stacked_r_factor(
    parts: Sequence[FloatArray], places: Sequence[IntArray], width: int
) -> FloatArray:
    """R factor of rows that have only some of `width` columns, at their `places`; else zero."""
    spread = []
    for part, columns in zip(parts, places, strict=True):
        wide = np.zeros((len(part), width))
        wide[:, columns] = part
        spread.append(wide)
    return r_factor(np.vstack(spread))


@dataclass(frozen=True)
class Basis:
    """An orthonormal basis of the span of columns, and which of them it is made of.

    `vectors` (r, rank). `kept` (rank,) int, increasing: the columns that carry the span; each other
    depends on those before it. `upper` (rank, rank): vectors @ upper = columns[:, kept].
    """

    vectors: FloatArray
    kept: IntArray
    upper: FloatArray

    @property
    def rank(self) -> int:
        """How many columns are independent."""
        return len(self.kept)

    def leading(self, width: int) -> "Basis":
        """Basis of the first `width` columns."""
        rank = int(np.searchsorted(self.kept, width))
        return Basis(self.vectors[:, :rank], self.kept[:rank], self.upper[:rank, :rank])

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


def independent_basis(
    columns: FloatArray, scale: FloatArray | None = None, *, tolerance: float = ROUNDING
) -> Basis:
    """Basis of the span of `columns` (r, c), those first that come first.

    A column counts when more than `tolerance` of its `scale`, by default its own norm, is
    independent of the columns before it, so that the decision does not depend on units.
    """
    norms = np.linalg.norm(columns, axis=0)
    scale = norms if scale is None else scale
    kept = np.flatnonzero(norms > tolerance * scale)
    if len(kept) == 0:
        return Basis(np.zeros((len(columns), 0)), kept, np.zeros((0, 0)))
    vectors, upper = np.linalg.qr(columns[:, kept] / scale[kept])
    if len(upper) < upper.shape[1] or np.abs(np.diag(upper)).min() <= tolerance:
        kept = kept[independent_columns(columns[:, kept] / scale[kept], tolerance)[0]]
        vectors, upper = np.linalg.qr(columns[:, kept] / scale[kept])
    return Basis(vectors, kept, upper * scale[kept])
