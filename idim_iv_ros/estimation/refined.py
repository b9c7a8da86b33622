"""Refined IDIM-IV: y, X and Z filtered by the inverse of the residual's shaping filter (eq. 12)."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from idim_iv_ros.estimation.covariance import RefinedCovariance
from idim_iv_ros.estimation.least_squares import solve_instrumental_variables
from idim_iv_ros.estimation.rows import JointRows
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
    rows: Sequence[JointRows], residuals: Sequence[FloatArray]
) -> tuple[AutoregressiveModel, ...]:
    """Autoregressive model of each joint's residual, order by AIC."""
    return tuple(
        fit_autoregression(residual, joint.segments)
        for joint, residual in zip(rows, residuals, strict=True)
    )


def refined_idim_iv(
    rows: Sequence[JointRows], models: Sequence[AutoregressiveModel], parameters: int
) -> RefinedIdimIv:
    """β̂ᶠ = (ZfᵀXf)⁻¹ Zfᵀyf and Σ = σ̂²(ZfᵀZf)⁻¹, each joint with its own filter and σ.

    With the observation matrices as instruments it is the refined IDIM-LS. The filtered rows of
    a joint are reduced and forgotten.
    """
    filtered = [joint.whitened(model).reduced for joint, model in zip(rows, models, strict=True)]
    sigma = np.sqrt([max(model.innovation_variance, 1e-300) for model in models])
    for _ in range(2):
        linear = solve_instrumental_variables(filtered, parameters, sigma)
        sigma = linear.sigma
    covariance = RefinedCovariance(filtered, sigma, parameters).matrix
    return RefinedIdimIv(linear.values, covariance, tuple(models))
