"""How well a motion excites the base parameters: condition numbers and standard deviations."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from idim_iv_ros.errors import UsageError
from idim_iv_ros.estimation.qr import streamed_r_factor
from idim_iv_ros.excitation.trajectory import Trajectory
from idim_iv_ros.model import InverseModel
from idim_iv_ros.types import FloatArray

_BLOCK = 2000

# A parameter counts as badly excited above this relative standard deviation, or below this share
# of its column that no combination of the other columns explains.
BAD_DEVIATION = 0.10
BAD_SHARE = 0.10


@dataclass(frozen=True)
class ConditionNumbers:
    """Ratio of the largest to the smallest singular value of the base regressor of a motion."""

    plain: float  # Rows and columns as they are (SI units): what publications state
    weighted: float  # Rows of joint j divided by its torque limit: what the design minimises
    # Weighted rows, and every column divided by its norm: free of the choice of units
    equilibrated: float
    # Geometric mean of the standard deviations along the principal directions, for one sample and a
    # torque noise of the torque limit (SI units): smaller is better. Unlike a condition number it
    # differs between a fast motion and a slow one.
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

    - `torque_limit`: (n_joints,) N m (N)
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


@dataclass(frozen=True)
class PredictedParameter:
    """One base parameter."""

    name: str
    unit: str
    given: float  # Value of the nominal model
    std: float  # Predicted standard deviation
    # Share of the length of its weighted column that the others do not explain, 0 to 1
    unexplained: float

    @property
    def relative_std(self) -> float | None:
        """Std over the given value; None where that is zero."""
        return None if self.given == 0.0 else self.std / abs(self.given)

    @property
    def bad(self) -> bool:
        """Whether the motion shows this parameter badly."""
        relative = self.relative_std
        return self.unexplained < BAD_SHARE or (relative is not None and relative > BAD_DEVIATION)


def predict_parameters(
    model: InverseModel,
    period: Trajectory,
    repeats: int,
    torque_limit: FloatArray,
    torque_noise: float,
) -> tuple[PredictedParameter, ...]:
    """Predict the standard deviations of all base parameters, the worst first.

    Least squares under white torque noise of standard deviation `torque_noise` · limit at every
    sample: cov = (XᵀΩX)⁻¹ / repeats, Ω = diag(1 / σ_j²). Real errors of the model are larger.

    - `torque_limit`: (n_joints,) N m (N)
    - `torque_noise`: share of the torque limit

    Raises
    ------
    UsageError
        `torque_noise` is not positive.
    """
    if not (np.isfinite(torque_noise) and torque_noise > 0.0):
        raise UsageError(f"torque noise {torque_noise:g}: a share of the limit above 0 is needed")
    upper = weighted_r_factor(model, period, 1.0 / (torque_noise * torque_limit)) * np.sqrt(repeats)
    norms = np.linalg.norm(upper, axis=0)
    # Of the equilibrated factor: columns of unit length.
    inverse = np.linalg.pinv(upper / np.where(norms > 0.0, norms, 1.0))
    spread = np.linalg.norm(inverse, axis=1)
    parameters = [
        PredictedParameter(name, unit, float(given), float(s / norm), float(1.0 / s))
        for name, unit, given, s, norm in zip(
            model.base.names, model.base.units, model.given, spread, norms, strict=True
        )
    ]
    return tuple(sorted(parameters, key=_order))


def _order(parameter: PredictedParameter) -> tuple[bool, float]:
    """Relative deviations from the largest; then, without a given value, the least shown."""
    relative = parameter.relative_std
    return (True, parameter.unexplained) if relative is None else (False, -relative)
