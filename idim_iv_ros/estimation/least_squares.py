"""Linear estimators on the rows of all joints: IDIM-LS and one step of IDIM-IV (equation 9)."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from idim_iv_ros.errors import DataError
from idim_iv_ros.estimation.r_factor import r_factor, spread
from idim_iv_ros.estimation.rows import ObservationRows
from idim_iv_ros.estimation.triangles import (
    InstrumentTriangle,
    JointTriangle,
    instrument_triangles,
    residual_sigma,
    stacked,
    triangles_of_rows,
)
from idim_iv_ros.types import FloatArray

_LARGEST_CONDITION = 1e12


@dataclass(frozen=True)
class LinearEstimate:
    """Solution of a linear system in the base parameters.

    Attributes
    ----------
    values : (b,)
    residuals : one (r_j,) array for each joint
        y - X β, N m.
    sigma : (n_joints,)
        Standard deviation of each joint's residual, N m.
    """

    values: FloatArray
    residuals: tuple[FloatArray, ...]
    sigma: FloatArray


def solve_triangles(
    triangles: Sequence[JointTriangle], parameters: int, *, weighted: bool = True
) -> tuple[FloatArray, FloatArray]:
    """IDIM-LS, ordinary or with each joint weighted by the inverse of its residual's σ.

    Returns
    -------
    values : (b,)
    sigma : (n_joints,) N m

    Raises
    ------
    DataError
        Fewer rows than parameters.
    """
    total = sum(joint.rows for joint in triangles)
    _require_rows(total, parameters)
    torque = max(float(np.linalg.norm(joint.triangle[:, -1])) for joint in triangles)
    largest = torque / np.sqrt(total)
    weights: FloatArray | None = None
    for _ in range(3 if weighted else 1):
        triangle = stacked(triangles, parameters, weights)
        square, right = triangle[:parameters, :parameters], triangle[:parameters, -1]
        values = np.asarray(np.linalg.solve(square, right), dtype=np.float64)
        sigma = _floor(residual_sigma(triangles, values), largest)
        weights = 1.0 / sigma
    return values, sigma


def solve_least_squares(rows: Sequence[ObservationRows], parameters: int) -> LinearEstimate:
    """Ordinary IDIM-LS: all rows weighted alike."""
    values, sigma = solve_triangles(triangles_of_rows(rows), parameters, weighted=False)
    return LinearEstimate(values, _residuals(rows, values), sigma)


def solve_weighted_least_squares(
    rows: Sequence[ObservationRows], parameters: int
) -> LinearEstimate:
    """IDIM-LS with each joint weighted by the inverse of its residual's standard deviation."""
    values, sigma = solve_triangles(triangles_of_rows(rows), parameters)
    return LinearEstimate(values, _residuals(rows, values), sigma)


def solve_instrumental_variables(
    rows: Sequence[ObservationRows],
    instruments: Sequence[FloatArray],
    parameters: int,
    sigma: FloatArray,
) -> LinearEstimate:
    """β = (ZᵀΩ⁻¹X)⁻¹ ZᵀΩ⁻¹y with Ω = blkdiag(σ_j² I) (equation 9, weighted joint by joint).

    Solved on the triangle of [Z X y]: with Z = QR it is (QᵀX)⁻¹ Qᵀy.

    Raises
    ------
    DataError
        Fewer rows than parameters, or the instruments do not determine the parameters.
    """
    triangles = instrument_triangles(rows, instruments)
    values, deviations = solve_instrument_triangles(triangles, parameters, sigma)
    return LinearEstimate(values, _residuals(rows, values), deviations)


def solve_instrument_triangles(
    triangles: Sequence[InstrumentTriangle], parameters: int, sigma: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Solve equation 9 on the triangles of [Z_j X_j y_j], joint j weighted by 1/`sigma[j]`.

    Returns
    -------
    values : (b,)
    sigma : (n_joints,)
        Standard deviation of each joint's residual.

    Raises
    ------
    DataError
        See `solve_instrumental_variables`.
    """
    total = sum(joint.rows for joint in triangles)
    _require_rows(total, parameters)
    parts = []
    for joint, deviation in zip(triangles, sigma, strict=True):
        places = np.concatenate([joint.columns, joint.columns + parameters, [2 * parameters]])
        parts.append(spread(joint.triangle / deviation, places, 2 * parameters + 1))
    triangle = r_factor(np.vstack(parts))
    projected = triangle[:parameters, parameters : 2 * parameters]
    scale = np.linalg.norm(projected, axis=0)
    if np.any(scale == 0.0) or np.linalg.cond(projected / scale) > _LARGEST_CONDITION:
        raise DataError("the instruments do not determine all parameters")
    values = np.asarray(np.linalg.solve(projected, triangle[:parameters, -1]), dtype=np.float64)
    share = 1.0 - parameters / total
    deviations = np.empty(len(triangles))
    for number, joint in enumerate(triangles):
        residual = joint.torque - joint.regressor @ values[joint.columns]
        deviations[number] = np.sqrt(float(residual @ residual) / max(joint.rows * share, 1.0))
    largest = max(float(np.linalg.norm(joint.torque)) for joint in triangles)
    return values, _floor(deviations, largest / np.sqrt(total))


def _residuals(rows: Sequence[ObservationRows], values: FloatArray) -> tuple[FloatArray, ...]:
    return tuple(joint.torque - joint.matrix @ values[joint.columns] for joint in rows)


def _floor(sigma: FloatArray, torque: float) -> FloatArray:
    """A residual that is zero to rounding must not get an infinite weight."""
    return np.maximum(sigma, max(1e-12 * torque, 1e-300))


def _require_rows(total: int, parameters: int) -> None:
    if total <= parameters:
        raise DataError(
            f"{total} decimated rows cannot determine {parameters} parameters; record for longer "
            "or raise processing.decimation_cutoff"
        )
