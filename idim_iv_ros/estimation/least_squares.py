"""Linear estimators on the rows of all joints: IDIM-LS and one step of IDIM-IV (equation 9).

All work on R factors: the rows of each joint are reduced once, and rows that are reduced already
(`JointRows.reduced`, `streamed_rows`) serve as well.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from idim_iv_ros.errors import DataError
from idim_iv_ros.estimation.qr import NOT_SHOWN, independent_basis, stacked_r_factor
from idim_iv_ros.estimation.rows import JointRows
from idim_iv_ros.types import FloatArray

# Rounds of new weights; the estimate hardly depends on them.
_WEIGHTINGS = 3


@dataclass(frozen=True)
class LinearEstimate:
    """Solution of a linear system in the base parameters.

    `values` (b,); `residuals` one (r_j,) array for each joint: y - X β, N m; `sigma` (n_joints,):
    standard deviation of each joint's residual, N m.
    """

    values: FloatArray
    residuals: tuple[FloatArray, ...]
    sigma: FloatArray


def solve_least_squares(
    rows: Sequence[JointRows], parameters: int, *, weighted: bool = True
) -> LinearEstimate:
    """IDIM-LS, ordinary or with each joint weighted by the inverse of its residual's σ.

    Raises
    ------
    DataError
        Fewer rows than parameters.
    """
    total = _number_of_rows(rows, parameters)
    # The b estimated parameters are charged to the joints in proportion to their rows.
    share = max(1.0 - parameters / total, 1.0 / total)
    weights = np.ones(len(rows))
    for _ in range(_WEIGHTINGS if weighted else 1):
        factor = stacked(rows, parameters, weights)
        values = independent_basis(factor[:, :-1]).solve(factor[:, -1], parameters)
        sigma = _sigma(rows, values, share, total)
        weights = 1.0 / sigma
    return LinearEstimate(values, _residuals(rows, values), sigma)


def solve_instrumental_variables(
    rows: Sequence[JointRows], parameters: int, sigma: FloatArray
) -> LinearEstimate:
    """β = (ZᵀΩ⁻¹X)⁻¹ ZᵀΩ⁻¹y with Ω = blkdiag(σ_j² I) (equation 9, weighted joint by joint).

    Solved on the R factor of [Z X y]: with Z = QR it is (QᵀX)⁻¹ Qᵀy.

    Raises
    ------
    DataError
        Fewer rows than parameters, or the instruments do not determine the parameters.
    """
    total = _number_of_rows(rows, parameters)
    _, projected, right = projected_on_instruments(rows, parameters, sigma)
    values = np.asarray(np.linalg.solve(projected, right), dtype=np.float64)
    share = 1.0 - parameters / total
    return LinearEstimate(values, _residuals(rows, values), _sigma(rows, values, share, total))


def projected_on_instruments(
    rows: Sequence[JointRows], parameters: int, sigma: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """R, QᵀX, both (b, b), and Qᵀy of the stacked Z = Q R, joint j weighted by 1/`sigma[j]`.

    Raises
    ------
    DataError
        The instruments do not determine the parameters.
    """
    parts, places = [], []
    for joint, deviation in zip(rows, sigma, strict=True):
        few = joint.reduced
        parts.append(np.column_stack([few.instruments, few.matrix, few.torque]) / deviation)
        places.append(np.concatenate([few.columns, few.columns + parameters, [2 * parameters]]))
    factor = stacked_r_factor(parts, places, 2 * parameters + 1)
    instruments = independent_basis(factor[:, :parameters])
    projected = instruments.vectors.T @ factor[:, parameters:-1]
    if independent_basis(projected).rank < parameters:
        raise DataError("the instruments do not determine all parameters")
    return instruments.upper, projected, instruments.vectors.T @ factor[:, -1]


def stacked(
    rows: Sequence[JointRows], parameters: int, weights: FloatArray | None = None
) -> FloatArray:
    """R factor (b + 1 columns) of [X y] of all joints, joint j multiplied by `weights[j]`."""
    factors = [joint.r_factor for joint in rows]
    if weights is not None:
        factors = [factor * weight for factor, weight in zip(factors, weights, strict=True)]
    return stacked_r_factor(factors, [joint.places for joint in rows], parameters + 1)


def unseen_parameters(rows: Sequence[JointRows], parameters: int) -> list[int]:
    """Base parameters whose columns depend on those before them in these rows."""
    columns = stacked(rows, parameters)[:, :parameters]
    norms = np.linalg.norm(columns, axis=0)
    columns[:, norms <= NOT_SHOWN * norms.max()] = 0.0
    shown = independent_basis(columns, tolerance=NOT_SHOWN).kept
    return sorted(set(range(parameters)) - set(shown.tolist()))


def condition_number(rows: Sequence[JointRows], parameters: int) -> float:
    """Condition number of the stacked, unweighted observation matrix X."""
    return float(np.linalg.cond(stacked(rows, parameters)[:parameters, :parameters]))


def _sigma(rows: Sequence[JointRows], values: FloatArray, share: float, total: int) -> FloatArray:
    """Standard deviation of each joint's residual; not so small that its weight is infinite."""
    sigma = [
        joint.assumed_sigma
        or np.linalg.norm(joint.reduced.residual(values)) / np.sqrt(max(len(joint) * share, 1.0))
        for joint in rows
    ]
    torque = max(float(np.linalg.norm(joint.reduced.torque)) for joint in rows) / np.sqrt(total)
    return np.maximum(sigma, max(1e-12 * torque, 1e-300))


def _residuals(rows: Sequence[JointRows], values: FloatArray) -> tuple[FloatArray, ...]:
    return tuple(joint.residual(values) for joint in rows)


def _number_of_rows(rows: Sequence[JointRows], parameters: int) -> int:
    total = sum(len(joint) for joint in rows)
    if total <= parameters:
        raise DataError(
            f"{total} decimated rows cannot determine {parameters} parameters; record for longer "
            "or raise processing.decimation_cutoff"
        )
    return total
