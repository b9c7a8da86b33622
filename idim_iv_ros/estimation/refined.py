"""Refined IDIM-IV: y, X and Z filtered by the inverse of the residual's colour (equation 12)."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from idim_iv_ros.estimation.covariance import JointBlock, RefinedCovariance
from idim_iv_ros.estimation.least_squares import solve_instrument_triangles
from idim_iv_ros.estimation.r_factor import r_factor
from idim_iv_ros.estimation.rows import ObservationRows
from idim_iv_ros.estimation.triangles import InstrumentTriangle
from idim_iv_ros.signals import AutoregressiveModel, fit_autoregression
from idim_iv_ros.types import FloatArray


@dataclass(frozen=True)
class RefinedIdimIv:
    """Refined estimate with its covariance.

    Attributes
    ----------
    values : (b,)
    covariance : (b, b)
    models : one AutoregressiveModel for each joint
        Ĉ(z⁻¹), fitted on the unfiltered IV residual.
    """

    values: FloatArray
    covariance: FloatArray
    models: tuple[AutoregressiveModel, ...]


def residual_models(
    rows: Sequence[ObservationRows], residuals: Sequence[FloatArray]
) -> tuple[AutoregressiveModel, ...]:
    """Autoregressive model of each joint's residual, order by AIC."""
    return tuple(
        fit_autoregression(residual, joint.runs)
        for joint, residual in zip(rows, residuals, strict=True)
    )


def refined_idim_iv(
    rows: Sequence[ObservationRows],
    instruments: Sequence[FloatArray],
    models: Sequence[AutoregressiveModel],
    parameters: int,
) -> RefinedIdimIv:
    """β̂ᶠ = (ZfᵀXf)⁻¹ Zfᵀyf and Σ = σ̂²(ZfᵀZf)⁻¹, each joint with its own filter and σ.

    With the observation matrices as instruments it is the refined IDIM-LS. The filtered rows of
    a joint are reduced to a triangle and forgotten.
    """
    triangles = []
    for joint, matrix, model in zip(rows, instruments, models, strict=True):
        same = matrix is joint.matrix
        columns = [joint.matrix, joint.torque] if same else [matrix, joint.matrix, joint.torque]
        filtered = model.whiten(np.column_stack(columns), joint.runs)
        white = r_factor(filtered)
        if same:
            white = np.column_stack([white[:, :-1], white])
        triangles.append(InstrumentTriangle(joint.columns, white, len(joint)))
    sigma = np.sqrt([max(model.innovation_variance, 1e-300) for model in models])
    for _ in range(2):
        values, sigma = solve_instrument_triangles(triangles, parameters, sigma)
    blocks = [
        JointBlock(joint.regressor, joint.instruments, joint.columns, float(deviation))
        for joint, deviation in zip(triangles, sigma, strict=True)
    ]
    return RefinedIdimIv(values, RefinedCovariance(blocks, parameters).matrix, tuple(models))
