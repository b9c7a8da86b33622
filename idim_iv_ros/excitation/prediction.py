"""Standard deviations that a motion promises, parameter by parameter."""

from dataclasses import dataclass

import numpy as np

from idim_iv_ros.errors import UsageError
from idim_iv_ros.excitation.criterion import weighted_r_factor
from idim_iv_ros.excitation.trajectory import Trajectory
from idim_iv_ros.model import InverseModel
from idim_iv_ros.types import FloatArray

# A parameter counts as badly excited above this relative standard deviation, or below this share
# of its column that no combination of the other columns explains.
BAD_DEVIATION = 0.10
BAD_SHARE = 0.10


@dataclass(frozen=True)
class PredictedParameter:
    """One base parameter.

    Attributes
    ----------
    name, unit : str
    given : float
        Value of the nominal model.
    std : float
        Predicted standard deviation.
    unexplained : float
        Share of the length of its weighted column that the others do not explain, 0 to 1.
    """

    name: str
    unit: str
    given: float
    std: float
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

    Parameters
    ----------
    torque_limit : (n_joints,) N m (N)
    torque_noise : share of the torque limit

    Raises
    ------
    UsageError
        `torque_noise` is not positive.
    """
    if not (np.isfinite(torque_noise) and torque_noise > 0.0):
        raise UsageError(f"torque noise {torque_noise:g}: a share of the limit above 0 is needed")
    weights = np.sqrt(repeats) / (torque_noise * torque_limit)
    upper = weighted_r_factor(model, period, weights)
    norms = np.linalg.norm(upper, axis=0)
    # Of the equilibrated R factor: columns of unit length.
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
