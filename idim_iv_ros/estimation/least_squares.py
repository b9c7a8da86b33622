"""Linear estimators on the rows of all joints: IDIM-LS and one step of IDIM-IV (equation 9)."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from idim_iv_ros.errors import DataError
from idim_iv_ros.estimation.rows import ObservationRows

FloatArray = NDArray[np.float64]

# A parameter is unseen when less than this share of its column is independent of the others.
RANK_TOLERANCE = 1e-6


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


def triangle_of(
    rows: Sequence[ObservationRows],
    parameters: int,
    *,
    instruments: Sequence[FloatArray] | None = None,
    weights: FloatArray | None = None,
) -> FloatArray:
    """R factor of the stacked rows [Z X y] (or [X y]), joint j multiplied by `weights[j]`.

    Returns
    -------
    upper triangle with 2 b + 1 (or b + 1) columns
    """
    blocks = 1 if instruments is None else 2
    width = blocks * parameters + 1
    stacked = []
    for number, joint in enumerate(rows):
        weight = 1.0 if weights is None else float(weights[number])
        parts = [joint.matrix, joint.torque[:, None]]
        places = [joint.columns + (blocks - 1) * parameters, np.array([width - 1])]
        if instruments is not None:
            parts.insert(0, instruments[number])
            places.insert(0, joint.columns)
        small = np.linalg.qr(np.hstack(parts) * weight, mode="r")
        spread = np.zeros((len(small), width))
        spread[:, np.concatenate(places)] = small
        stacked.append(spread)
    return np.asarray(np.linalg.qr(np.vstack(stacked), mode="r"))


def solve_least_squares(
    rows: Sequence[ObservationRows], parameters: int, weights: FloatArray | None = None
) -> LinearEstimate:
    """IDIM-LS: ordinary, or each joint weighted.

    Raises
    ------
    DataError
        Fewer rows than parameters.
    """
    _require_rows(rows, parameters)
    triangle = triangle_of(rows, parameters, weights=weights)
    values = np.linalg.solve(triangle[:parameters, :parameters], triangle[:parameters, -1])
    return _estimate(rows, values)


def solve_weighted_least_squares(rows: Sequence[ObservationRows], parameters: int) -> LinearEstimate:
    """IDIM-LS with each joint weighted by the inverse of its residual's standard deviation."""
    estimate = solve_least_squares(rows, parameters)
    for _ in range(2):
        estimate = solve_least_squares(rows, parameters, weights=1.0 / estimate.sigma)
    return estimate


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
    _require_rows(rows, parameters)
    triangle = triangle_of(rows, parameters, instruments=instruments, weights=1.0 / sigma)
    projected = triangle[:parameters, parameters : 2 * parameters]
    scale = np.linalg.norm(projected, axis=0)
    if np.any(scale == 0.0) or np.linalg.cond(projected / scale) > 1e12:
        raise DataError("the instruments do not determine all parameters")
    return _estimate(rows, np.linalg.solve(projected, triangle[:parameters, -1]))


def unseen_parameters(rows: Sequence[ObservationRows], parameters: int) -> list[int]:
    """Base parameters whose columns depend on those before them in these rows."""
    triangle = triangle_of(rows, parameters)[:, :parameters]
    norms = np.linalg.norm(triangle, axis=0)
    basis = np.zeros((len(triangle), 0))
    unseen = []
    for column in range(parameters):
        if norms[column] <= RANK_TOLERANCE * norms.max():
            unseen.append(column)
            continue
        direction = triangle[:, column] / norms[column]
        for _ in range(2):
            direction = direction - basis @ (basis.T @ direction)
        independent = float(np.linalg.norm(direction))
        if independent <= RANK_TOLERANCE:
            unseen.append(column)
        else:
            basis = np.column_stack([basis, direction / independent])
    return unseen


def condition_number(rows: Sequence[ObservationRows], parameters: int) -> float:
    """Condition number of the stacked, unweighted observation matrix X."""
    return float(np.linalg.cond(triangle_of(rows, parameters)[:parameters, :parameters]))


def _require_rows(rows: Sequence[ObservationRows], parameters: int) -> None:
    total = sum(len(joint) for joint in rows)
    if total <= parameters:
        raise DataError(
            f"{total} decimated rows cannot determine {parameters} parameters; record for longer "
            "or raise processing.decimation_cutoff"
        )


def _estimate(rows: Sequence[ObservationRows], values: FloatArray) -> LinearEstimate:
    residuals = tuple(joint.torque - joint.matrix @ values[joint.columns] for joint in rows)
    total = sum(len(joint) for joint in rows)
    share = 1.0 - len(values) / total
    sigma = np.array(
        [np.sqrt(float(e @ e) / max(len(e) * share, 1.0)) if len(e) else 1.0 for e in residuals]
    )
    largest = max(float(np.abs(joint.torque).max(initial=0.0)) for joint in rows)
    return LinearEstimate(values, residuals, np.maximum(sigma, 1e-12 * max(largest, 1e-300)))
