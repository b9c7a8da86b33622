"""How uncertain the estimates are: one estimator of their covariance a class.

All work on triangles: the rows of each joint are reduced by QR once, and ZᵀZ or ZᵀX is never
formed, which would square the condition number.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from idim_iv_ros.estimation.r_factor import r_factor, spread
from idim_iv_ros.signals.autoregression import AutoregressiveModel
from idim_iv_ros.types import FloatArray

IntArray = NDArray[np.integer[Any]]

_COLUMNS, _ROWS = 4, 5_000


@dataclass(frozen=True)
class JointBlock:
    """The rows of one joint as a covariance needs them.

    Attributes
    ----------
    regressor, instruments : (r_j, c_j)
        X_j and Z_j: only the columns that are not structurally zero for this joint.
    columns : (c_j,) int
        Places of these columns among all b parameters.
    sigma : float
        Standard deviation of this joint's residual; the rows are weighted by 1/sigma.
    """

    regressor: FloatArray
    instruments: FloatArray
    columns: IntArray
    sigma: float


@dataclass(frozen=True)
class AutocorrelatedBlock(JointBlock):
    """The unfiltered rows of one joint and the colour of its residual.

    Attributes
    ----------
    autoregression : AutoregressiveModel
        Fitted on the residual of this joint, in its unit.
    positions : (r_j,) increasing int
        Place of each row on the regular decimated grid; recordings far apart.
    """

    autoregression: AutoregressiveModel
    positions: IntArray


@dataclass(frozen=True)
class WhiteCovariance:
    """Σ = (ZᵀWX)⁻¹ ZᵀWZ (XᵀWZ)⁻¹, W = blkdiag(I/σ_j²): right if every residual is white.

    With Z = X it is the covariance of (weighted) least squares, σ²(XᵀX)⁻¹.
    """

    blocks: Sequence[JointBlock]
    n_parameters: int

    @property
    def matrix(self) -> FloatArray:
        """(b, b), in the products of the parameters' units."""
        _, projected = _reduce(self.blocks, self.n_parameters)
        root = np.linalg.inv(projected)
        return root @ root.T


@dataclass(frozen=True)
class AutocorrelatedCovariance:
    """Σ = A S Aᵀ of the estimate from unfiltered rows, when each joint's residual is AR(p).

    A = (ZᵀWX)⁻¹ and S = Σ_j σ_j⁻⁴ Z_jᵀ R_j Z_j, with R_j the covariance of the joint's residual
    at the places of its rows; Z_jᵀ R_j Z_j = σ²_N,j ‖H_jᵀ Z_j‖² with H_j = 1/Ĉ_j on the regular
    grid, where Z_j is zero at the dropped rows.
    """

    blocks: Sequence[AutocorrelatedBlock]
    n_parameters: int

    @property
    def matrix(self) -> FloatArray:
        """(b, b), in the products of the parameters' units."""
        return self.restricted(np.arange(self.n_parameters))

    def restricted(self, kept: IntArray) -> FloatArray:
        """Covariance (b_e, b_e) of the estimate with only the parameters `kept`, same weights."""
        both = np.concatenate([kept, kept + self.n_parameters])
        triangle, projected = _split(r_factor(self._stacked[:, both]), len(kept))
        spectrum = r_factor(self._spectrum[:, kept])
        # A = (Rᵀ QᵀX)⁻¹ = (QᵀX)⁻¹ R⁻ᵀ, so that Σ = BᵀB with B = S^½ R⁻¹ (QᵀX)⁻ᵀ.
        root = np.linalg.solve(projected, np.linalg.solve(triangle.T, spectrum.T)).T
        return np.asarray(root.T @ root)

    @cached_property
    def _stacked(self) -> FloatArray:
        return _stack(self.blocks, self.n_parameters)

    @cached_property
    def _spectrum(self) -> FloatArray:
        """S^½, upper triangular (b, b)."""
        pieces = []
        for block in self.blocks:
            scale = np.sqrt(block.autoregression.innovation_variance) / block.sigma**2
            small = _coloured_triangle(block) * scale
            pieces.append(spread(small, block.columns, self.n_parameters))
        return r_factor(np.vstack(pieces))


@dataclass(frozen=True)
class RefinedCovariance:
    """Σ = (Z_fᵀ W Z_f)⁻¹ of the refined estimate (paper, equation 12), joint by joint weighted.

    The blocks hold rows filtered by Ĉ_j(z⁻¹), and sigma is that of the whitened residual; with
    one σ for all joints it is the paper's σ̂²(Z_fᵀZ_f)⁻¹.
    """

    blocks: Sequence[JointBlock]
    n_parameters: int

    @property
    def matrix(self) -> FloatArray:
        """(b, b), in the products of the parameters' units."""
        triangle, _ = _reduce(self.blocks, self.n_parameters)
        root = np.linalg.inv(triangle)
        return root @ root.T


def _reduce(blocks: Sequence[JointBlock], n_parameters: int) -> tuple[FloatArray, FloatArray]:
    """Return R and QᵀX of the stacked, weighted Z = Q R, both (b, b).

    Raises
    ------
    numpy.linalg.LinAlgError
        If the instruments do not determine all parameters.
    """
    return _split(_stack(blocks, n_parameters), n_parameters)


def _stack(blocks: Sequence[JointBlock], n_parameters: int) -> FloatArray:
    """R of the stacked, weighted [Z X], with 2 b columns."""
    pieces = []
    for block in blocks:
        if block.instruments is block.regressor:
            single = r_factor(block.instruments)
            small = np.hstack([single, single]) / block.sigma
        else:
            small = r_factor(np.hstack([block.instruments, block.regressor])) / block.sigma
        places = np.concatenate([block.columns, block.columns + n_parameters])
        pieces.append(spread(small, places, 2 * n_parameters))
    return r_factor(np.vstack(pieces))


def _split(triangle: FloatArray, n_parameters: int) -> tuple[FloatArray, FloatArray]:
    if len(triangle) < n_parameters:
        raise np.linalg.LinAlgError("fewer rows than parameters")
    square = triangle[:n_parameters, :n_parameters]
    projected = triangle[:n_parameters, n_parameters:]
    pivots = np.abs(np.diag(square))
    scale = np.linalg.norm(square, axis=0)
    if np.any(pivots <= np.finfo(float).eps * n_parameters * scale):
        raise np.linalg.LinAlgError("the instruments do not determine all parameters")
    return square, projected


def _coloured_triangle(block: AutocorrelatedBlock) -> FloatArray:
    """R of H_jᵀ Z_j, a few columns and a few rows at a time for the sake of memory."""
    width = block.instruments.shape[1]
    coloured: FloatArray | None = None
    for start in range(0, width, _COLUMNS):
        columns = block.instruments[:, start : start + _COLUMNS]
        part = block.autoregression.colour_adjoint(columns, block.positions)
        if coloured is None:
            coloured = np.empty((len(part), width))
        coloured[:, start : start + _COLUMNS] = part
    triangle = np.zeros((0, width))
    for start in range(0, 0 if coloured is None else len(coloured), _ROWS):
        assert coloured is not None
        triangle = r_factor(np.vstack([triangle, coloured[start : start + _ROWS]]))
    return triangle
