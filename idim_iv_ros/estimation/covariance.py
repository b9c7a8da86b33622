"""How uncertain the estimates are: the estimators of their covariance.

All work on R factors: ZᵀZ or ZᵀX is never formed, which would square the condition number.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from idim_iv_ros.estimation.least_squares import projected_on_instruments
from idim_iv_ros.estimation.qr import independent_basis, r_factor, stacked_r_factor
from idim_iv_ros.estimation.rows import JointRows
from idim_iv_ros.signals.autoregression import AutoregressiveModel
from idim_iv_ros.types import FloatArray, IntArray

_COLUMNS = 4


def white_covariance(rows: Sequence[JointRows], sigma: FloatArray, parameters: int) -> FloatArray:
    """Σ = (ZᵀWX)⁻¹ ZᵀWZ (XᵀWZ)⁻¹, W = blkdiag(I/σ_j²): right if every residual is white.

    With Z = X it is the covariance of (weighted) least squares, σ²(XᵀX)⁻¹.

    `sigma`: (n_joints,) Standard deviation of each joint's residual; `parameters`: b.

    Returns
    -------
    (b, b), in the products of the parameters' units.

    Raises
    ------
    DataError
        The instruments do not determine all parameters.
    """
    _, projected, _ = projected_on_instruments(rows, parameters, sigma)
    root = np.linalg.inv(projected)
    return np.asarray(root @ root.T)


def refined_covariance(rows: Sequence[JointRows], sigma: FloatArray, parameters: int) -> FloatArray:
    """Σ = (Z_fᵀ W Z_f)⁻¹ of the refined estimate (paper, equation 12), joint by joint weighted.

    The rows are filtered by Ĉ_j(z⁻¹), and sigma is that of the whitened residual; with one σ for
    all joints it is the paper's σ̂²(Z_fᵀZ_f)⁻¹. Parameters as for `white_covariance`.
    """
    upper, _, _ = projected_on_instruments(rows, parameters, sigma)
    root = independent_basis(upper).inverse_root(parameters)
    return root @ root.T


@dataclass(frozen=True)
class AutocorrelatedCovariance:
    """Σ = A S Aᵀ of the estimate from unfiltered rows, when each joint's residual is AR(p).

    A = (ZᵀWX)⁻¹ and S = Σ_j σ_j⁻⁴ Z_jᵀ R_j Z_j, with R_j the covariance of the joint's residual
    at the places of its rows; Z_jᵀ R_j Z_j = σ²_N,j ‖H_jᵀ Z_j‖² with H_j = 1/Ĉ_j on the regular
    grid, where Z_j is zero at the dropped rows.

    Attributes
    ----------
    rows : sequence of JointRows
        Unfiltered, with their `position`.
    sigma : (n_joints,)
        Standard deviation of each joint's residual: the weights of the estimate.
    models : sequence of AutoregressiveModel
        Fitted on the residual of each joint, in its unit.
    parameters : int
        b.
    """

    rows: Sequence[JointRows]
    sigma: FloatArray
    models: Sequence[AutoregressiveModel]
    parameters: int

    @property
    def matrix(self) -> FloatArray:
        """(b, b), in the products of the parameters' units."""
        return self.restricted(np.arange(self.parameters))

    def restricted(self, kept: IntArray) -> FloatArray:
        """Covariance (b_e, b_e) of the estimate with only the parameters `kept`, same weights."""
        rows = [joint.reduced.keep(kept) for joint in self.rows]
        upper, projected, _ = projected_on_instruments(rows, len(kept), self.sigma)
        spectrum = r_factor(self._spectrum[:, kept])
        # A = (Rᵀ QᵀX)⁻¹ = (QᵀX)⁻¹ R⁻ᵀ, so that Σ = BᵀB with B = S^½ R⁻¹ (QᵀX)⁻ᵀ.
        root = np.linalg.solve(projected, np.linalg.solve(upper.T, spectrum.T)).T
        return np.asarray(root.T @ root)

    @cached_property
    def _spectrum(self) -> FloatArray:
        """S^½, upper triangular (b, b)."""
        factors = [
            _shaped_r_factor(joint, model) * np.sqrt(model.innovation_variance) / sigma**2
            for joint, sigma, model in zip(self.rows, self.sigma, self.models, strict=True)
        ]
        return stacked_r_factor(factors, [joint.columns for joint in self.rows], self.parameters)


def _shaped_r_factor(rows: JointRows, model: AutoregressiveModel) -> FloatArray:
    """R of H_jᵀ Z_j, a few columns and a few rows at a time for the sake of memory."""
    assert rows.position is not None
    width = len(rows.columns)
    shaped = np.zeros((0, width))
    for start in range(0, width, _COLUMNS):
        columns = rows.instruments[:, start : start + _COLUMNS]
        part = model.shaping_adjoint(columns, rows.position)
        if not len(shaped):
            shaped = np.empty((len(part), width))
        shaped[:, start : start + _COLUMNS] = part
    return r_factor(shaped)
