"""How well a motion excites the base parameters: condition numbers and predicted deviations."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from idim_iv_ros.estimation.qr import streamed_r_factor
from idim_iv_ros.excitation.trajectory import Trajectory
from idim_iv_ros.model import InverseModel
from idim_iv_ros.types import FloatArray

_BLOCK = 2000


@dataclass(frozen=True)
class ConditionNumbers:
    """Ratio of the largest to the smallest singular value of the base regressor of a motion.

    Attributes
    ----------
    plain : float
        All rows alike, columns as they are (SI units): what publications state.
    weighted : float
        Rows of joint j divided by its torque limit: what the design minimises.
    equilibrated : float
        Weighted rows, and every column divided by its norm: free of the choice of units.
    deviation : float
        Geometric mean of the standard deviations along the principal directions, for one sample
        and a torque noise of the torque limit (SI units): smaller is better. Unlike a condition
        number it tells a fast motion from a slow one.
    """

    plain: float
    weighted: float
    equilibrated: float
    deviation: float


def weighted_r_factor(model: InverseModel, motion: Trajectory, weights: FloatArray) -> FloatArray:
    """R factor (b, b) of the base regressor with the rows of joint j times weights[j].

    RᵀR = XᵀΩX over all samples of the motion, Ω = diag(weights²).
    """

    def blocks() -> Iterator[FloatArray]:
        for start in range(0, len(motion.position), _BLOCK):
            block = slice(start, start + _BLOCK)
            matrix = model.matrix(
                motion.position[block], motion.velocity[block], motion.acceleration[block]
            )
            yield (matrix * weights[:, None]).reshape(-1, matrix.shape[2])

    return streamed_r_factor(blocks(), len(model.base.columns))


def condition_numbers(
    model: InverseModel, motion: Trajectory, torque_limit: FloatArray
) -> ConditionNumbers:
    """Condition numbers of the base regressor over all samples of a motion.

    Parameters
    ----------
    torque_limit : (n_joints,) N m (N)
    """
    weighted = weighted_r_factor(model, motion, 1.0 / torque_limit)
    norms = np.linalg.norm(weighted, axis=0)
    equilibrated = weighted / np.where(norms > 0.0, norms, 1.0)
    plain = weighted_r_factor(model, motion, np.ones(len(torque_limit)))
    sigma = np.maximum(np.linalg.svd(weighted, compute_uv=False), np.finfo(float).tiny)
    deviation = np.sqrt(len(motion.position)) * np.exp(-np.mean(np.log(sigma)))
    return ConditionNumbers(
        plain=float(np.linalg.cond(plain)),
        weighted=float(np.linalg.cond(weighted)),
        equilibrated=float(np.linalg.cond(equilibrated)),
        deviation=float(deviation),
    )
