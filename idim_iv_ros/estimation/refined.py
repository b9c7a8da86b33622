"""Refined IDIM-IV: y, X and Z filtered by the inverse of the residual's colour (equation 12)."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from idim_iv_ros.estimation.covariance import JointBlock, RefinedCovariance
from idim_iv_ros.estimation.least_squares import LinearEstimate, solve_instrumental_variables
from idim_iv_ros.estimation.rows import ObservationRows
from idim_iv_ros.signals import AutoregressiveModel, fit_autoregression

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class RefinedIdimIv:
    """Refined estimate with its covariance.

    Attributes
    ----------
    linear : LinearEstimate
        Estimate and whitened residuals.
    covariance : (b, b)
    models : one AutoregressiveModel for each joint
        Ĉ(z⁻¹), fitted on the unfiltered IV residual.
    """

    linear: LinearEstimate
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

    With the observation matrices as instruments it is the refined IDIM-LS.
    """
    filtered, filtered_instruments = [], []
    for joint, matrix, model in zip(rows, instruments, models, strict=True):
        white = model.whiten(np.column_stack([joint.torque, joint.matrix, matrix]), joint.runs)
        width = len(joint.columns)
        filtered.append(replace(joint, torque=white[:, 0], matrix=white[:, 1 : width + 1]))
        filtered_instruments.append(white[:, width + 1 :])
    sigma = np.sqrt([max(model.innovation_variance, 1e-300) for model in models])
    linear = solve_instrumental_variables(filtered, filtered_instruments, parameters, sigma)
    linear = solve_instrumental_variables(filtered, filtered_instruments, parameters, linear.sigma)
    blocks = [
        JointBlock(joint.matrix, matrix, joint.columns, float(deviation))
        for joint, matrix, deviation in zip(
            filtered, filtered_instruments, linear.sigma, strict=True
        )
    ]
    covariance = RefinedCovariance(blocks, parameters).matrix
    return RefinedIdimIv(linear, covariance, tuple(models))
