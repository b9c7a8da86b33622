"""Noise of the rows of a comparison: autocorrelated, and larger where sampling missed torque."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from idim_iv_ros.diagnosis.comparison.ledger import Ledger
from idim_iv_ros.diagnosis.likelihood import noise_model
from idim_iv_ros.signals import AutoregressiveModel
from idim_iv_ros.types import FloatArray

_CLEAR = 3.0 * 1.4826  # three standard deviations, in medians of moduli


@dataclass(frozen=True, eq=False)
class RowNoise:
    """Noise of one joint's rows.

    Attributes
    ----------
    model : AutoregressiveModel
        Of the noise over its scale.
    scale : (r,)
        By how much it is larger than usual.
    """

    model: AutoregressiveModel
    scale: FloatArray

    def standardized(self, rows: FloatArray, segments: Sequence[slice]) -> FloatArray:
        """Whiten rows (r, …) so that the noise has unit variance."""
        scale = self.scale.reshape(-1, *(1,) * (rows.ndim - 1))
        return self.model.standardized(rows / scale, segments)


def noise_of(ledger: Ledger, residuals: Sequence[FloatArray]) -> tuple[RowNoise, ...]:
    """Noise of each joint's residual (r_j,)."""
    made = []
    for joint, (rows, left) in enumerate(zip(ledger.joints, residuals, strict=True)):
        scale, sigma = np.ones(len(left)), rows.assumed_sigma
        if sigma is None:
            if ledger.unsampled is not None:
                scale = scale_of(left, ledger.unsampled[joint])
            model = noise_model(left / scale, rows.segments)
        else:
            model = AutoregressiveModel(np.zeros(0), sigma**2)
        made.append(RowNoise(model, scale))
    return tuple(made)


def scale_of(residual: FloatArray, unsampled: FloatArray) -> FloatArray:
    """Scale (r,) of noise to which torque is added that sampling may have missed.

    Parameters
    ----------
    residual
        (r,) N m (N).
    unsampled
        (r,) content at half the rate of the recording, N m (N): what lies beyond is about as
        large, and has come down to the rows. Below the level that it usually has it is noise.
    """
    usual = float(np.median(residual**2)) * 1.4826**2
    missed = unsampled**2 - _CLEAR**2 * float(np.median(unsampled**2))
    return np.sqrt(1.0 + np.maximum(missed, 0.0) / max(usual, 1e-300))
