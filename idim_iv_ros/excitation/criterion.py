"""How well a motion shows the base parameters: figures of a motion, and what a design minimises."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np

from idim_iv_ros.errors import DataError
from idim_iv_ros.estimation.qr import streamed_r_factor
from idim_iv_ros.excitation.limits import MotionLimits, MovingFrames
from idim_iv_ros.excitation.trajectory import Trajectory
from idim_iv_ros.model import InverseModel
from idim_iv_ros.types import FloatArray

Criterion = Literal["condition", "precision"]

_STEP = 1e-6
# Speed, as a share of its limit, below which the sign of the Coulomb columns is smoothed.
_SMOOTH = 0.01


@dataclass(frozen=True)
class ExcitationCost:
    """Criterion on the weighted base regressor plus penalties for limits, on a coarse grid.

    κ_p = ‖σ‖_2p ‖1/σ‖_2p of the singular values σ tends to the condition number as p grows and,
    unlike it, is smooth where singular values coincide, which is where an optimum lies. A limit
    that is passed by a share e costs `weight` · e² at each point of the grid.
    """

    model: InverseModel
    limits: MotionLimits
    frames: MovingFrames
    shapes: FloatArray  # (3, n_samples, size): of a Fourier basis on the grid
    row_weights: FloatArray  # (n_joints,)
    start: FloatArray | None  # (n_joints,) or None: posture at rest; None: it is chosen too
    power: float  # p
    weight: float
    # What is minimised: log κ_p, or the mean of log 1/σ, of which the determinant of the covariance
    # is a function (D-optimality)
    criterion: Criterion = "condition"

    def unpack(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Start posture (n_joints,) and coefficients (size, n_joints) of a design vector."""
        joints, scale = len(self.limits.lower), self.limits.half_range
        coefficients = x[joints:].reshape(-1, joints) * scale
        if self.start is not None:
            return self.start, coefficients
        return self.limits.middle + x[:joints] * scale, coefficients

    def __call__(self, x: FloatArray) -> tuple[float, FloatArray]:
        """Cost and gradient of a design vector (n_joints · (1 + size),).

        Raises DataError: they are no finite numbers.
        """
        limits, (start, coefficients) = self.limits, self.unpack(x)
        states = self.shapes @ coefficients
        states[0] += start
        q = states[0].copy()
        regressor, slopes = self._regressors(states)
        value, by_entry = self._criterion(regressor)
        if limits.torque_checked:
            cost, by_torque = self._penalty(regressor @ self.model.given, limits.torque)
            value += cost
            by_entry += by_torque[:, :, None] * self.model.given
        by_state = np.einsum("sjc,ksjc->ks", by_entry, slopes, optimize=True)
        by_state = by_state.reshape(3, len(start), len(q)).transpose(0, 2, 1)
        states[0] -= limits.middle
        box = np.stack([limits.half_range, limits.velocity, limits.acceleration])
        of_box, by_box = self._penalty(states, box[:, None])
        of_floor, by_height = self._floor_penalty(q)
        value += of_box
        value += of_floor
        by_state = by_state + by_box
        by_state[0] += by_height
        scale = limits.half_range
        gradient = sum(s.T @ g for s, g in zip(self.shapes, by_state, strict=True)) * scale
        by_start = np.zeros(len(start)) if self.start is not None else by_state[0].sum(0) * scale
        slope = np.concatenate([by_start, np.ravel(gradient)])
        if not (np.isfinite(value) and np.all(np.isfinite(slope))):
            raise DataError(
                "the torques of the nominal model are beyond every number: look at the inertials, "
                "axes and limits of the URDF"
            )
        return value, slope

    def _regressors(self, states: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Base regressor (n_samples, n_joints, b), and its derivatives by q, dq and ddq."""
        _, samples, joints = states.shape
        states = np.tile(states, (1, 1 + 3 * joints, 1))
        states = states.reshape(3, 1 + 3 * joints, samples, joints)
        # The regressor is linear in the acceleration: a large step is exact.
        steps = (_STEP, _STEP, 1.0)
        for signal in range(3):
            for joint in range(joints):
                states[signal, 1 + signal * joints + joint, :, joint] += steps[signal]
        q, dq, ddq = states.reshape(3, -1, joints)
        matrices = self.model.matrix(q, dq, ddq, _SMOOTH * self.limits.velocity)
        matrices = matrices.reshape(1 + 3 * joints, samples, joints, -1)
        slopes = matrices[1:] - matrices[0]
        slopes /= np.repeat(steps, joints)[:, None, None, None]
        return matrices[0], slopes

    def _criterion(self, regressor: FloatArray) -> tuple[float, FloatArray]:
        """Log κ_p or mean log 1/σ, and its derivative by each entry of the unweighted regressor."""
        rows = regressor * self.row_weights[:, None]
        stacked = rows.reshape(-1, rows.shape[2])
        _, sigma, right = np.linalg.svd(np.linalg.qr(stacked, mode="r"))
        sigma = np.maximum(sigma, 1e-12 * sigma[0])
        if self.criterion == "precision":
            value = 0.5 * np.log(len(regressor)) - float(np.mean(np.log(sigma)))
            by_sigma = -1.0 / (len(sigma) * sigma)
        else:
            large = (sigma / sigma[0]) ** (2 * self.power)
            small = (sigma[-1] / sigma) ** (2 * self.power)
            value = np.log(sigma[0] / sigma[-1])
            value += (np.log(large.sum()) + np.log(small.sum())) / (2 * self.power)
            by_sigma = (large / large.sum() - small / small.sum()) / sigma
        # U = W V / σ
        left = stacked @ right.T / sigma
        by_entry = ((left * by_sigma) @ right).reshape(rows.shape)
        return float(value), by_entry * self.row_weights[:, None]

    def _penalty(self, values: FloatArray, limit: FloatArray) -> tuple[float, FloatArray]:
        """Penalty for values beyond their limit, and its derivatives by the values."""
        allowed = self.limits.margin * limit
        excess = np.maximum(np.abs(values) / allowed - 1.0, 0.0)
        slope = 2.0 * self.weight * excess * np.sign(values) / allowed
        return float(self.weight * np.sum(excess**2)), slope

    def _floor_penalty(self, q: FloatArray) -> tuple[float, FloatArray]:
        """Each 0.1 m below the floor counts as a limit passed by a share of 1."""
        if self.limits.floor is None:
            return 0.0, np.zeros_like(q)
        joints = q.shape[1]
        moved = np.concatenate([q, *(q + step for step in _STEP * np.eye(joints))])
        height, *others = np.split(self.frames.heights(moved), 1 + joints)
        excess = np.maximum(self.limits.floor - height, 0.0) / 0.1
        by_height = -2.0 * self.weight * excess / 0.1
        slopes = [np.sum(by_height * (other - height), axis=1) / _STEP for other in others]
        return float(self.weight * np.sum(excess**2)), np.column_stack(slopes)


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
            matrix = model.matrix(*(signal[block] for signal in motion.signals))
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
    """What a designed motion will show of a base parameter."""

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
    """
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
