"""Least squares from triangles: the R factor of each joint's rows replaces the rows.

Rows can be streamed: each block is folded into the triangle by QR and forgotten.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from idim_iv_ros.estimation.r_factor import r_factor, spread
from idim_iv_ros.estimation.rows import ObservationRows, row_blocks, torque_rows
from idim_iv_ros.model import InverseModel
from idim_iv_ros.signals import Motion
from idim_iv_ros.types import FloatArray, IntArray

# A parameter is unseen when less than this share of its column is independent of the others.
RANK_TOLERANCE = 1e-6
_FOLD = 2000  # rows that are folded at once


@dataclass(frozen=True)
class JointTriangle:
    """R factor of [X_j y_j].

    Attributes
    ----------
    columns : (c,) int
        Base parameters of the columns of X_j.
    triangle : (≤ c + 1, c + 1)
    rows : int
        How many rows it stands for.
    """

    columns: IntArray
    triangle: FloatArray
    rows: int


@dataclass(frozen=True)
class InstrumentTriangle:
    """R factor of [Z_j X_j y_j].

    Attributes
    ----------
    columns : (c,) int
        Base parameters of the columns of Z_j and of X_j.
    triangle : (≤ 2 c + 1, 2 c + 1)
    rows : int
        How many rows it stands for.
    """

    columns: IntArray
    triangle: FloatArray
    rows: int

    @property
    def instruments(self) -> FloatArray:
        """Rows that stand for Z_j."""
        return self.triangle[:, : len(self.columns)]

    @property
    def regressor(self) -> FloatArray:
        """Rows that stand for X_j."""
        return self.triangle[:, len(self.columns) : -1]

    @property
    def torque(self) -> FloatArray:
        """Rows that stand for y_j."""
        return self.triangle[:, -1]


def instrument_triangles(
    rows: Sequence[ObservationRows], instruments: Sequence[FloatArray]
) -> list[InstrumentTriangle]:
    """Reduce [Z_j X_j y_j] of each joint."""
    triangles = []
    for joint, matrix in zip(rows, instruments, strict=True):
        if matrix is joint.matrix:
            triangle = fold(np.zeros((0, len(joint.columns) + 1)), matrix, joint.torque)
            triangle = np.column_stack([triangle[:, :-1], triangle])
        else:
            triangle = np.zeros((0, 2 * len(joint.columns) + 1))
            for start in range(0, len(joint), _FOLD):
                block = slice(start, start + _FOLD)
                both = np.column_stack([matrix[block], joint.matrix[block]])
                triangle = fold(triangle, both, joint.torque[block])
        triangles.append(InstrumentTriangle(joint.columns, triangle, len(joint)))
    return triangles


def keep_parameters(joint: InstrumentTriangle, kept: IntArray) -> InstrumentTriangle:
    """Return the same rows with only the base parameters `kept`, renumbered in their order."""
    inside = np.isin(joint.columns, kept)
    chosen = joint.triangle[:, np.concatenate([inside, inside, [True]])]
    return InstrumentTriangle(
        np.searchsorted(kept, joint.columns[inside]),
        r_factor(chosen),
        joint.rows,
    )


def triangles_of_rows(rows: Sequence[ObservationRows]) -> tuple[JointTriangle, ...]:
    """Reduce rows that are already there."""
    return tuple(
        JointTriangle(
            joint.columns,
            fold(np.zeros((0, len(joint.columns) + 1)), joint.matrix, joint.torque),
            len(joint),
        )
        for joint in rows
    )


def stream_triangles(model: InverseModel, motions: Sequence[Motion]) -> tuple[JointTriangle, ...]:
    """Reduce recordings without ever holding their rows."""
    columns = [np.flatnonzero(active) for active in model.base.active]
    triangles = [np.zeros((0, len(active) + 1)) for active in columns]
    counts = [0] * len(columns)
    for motion in motions:
        torques = torque_rows(motion)
        done = [0] * len(columns)
        for block in row_blocks(model, motion, motion.derivatives):
            for joint, matrix in enumerate(block.matrices):
                torque = torques[joint][done[joint] : done[joint] + len(matrix)]
                triangles[joint] = fold(triangles[joint], matrix, torque)
                done[joint] += len(matrix)
        counts = [before + more for before, more in zip(counts, done, strict=True)]
    return tuple(
        JointTriangle(active, triangle, count)
        for active, triangle, count in zip(columns, triangles, counts, strict=True)
    )


def fold(triangle: FloatArray, matrix: FloatArray, torque: FloatArray) -> FloatArray:
    """R factor of a triangle stacked on new rows [X y]."""
    for start in range(0, len(matrix), _FOLD):
        block = slice(start, start + _FOLD)
        rows = np.column_stack([matrix[block], torque[block]])
        triangle = r_factor(np.vstack([triangle, rows]))
    return triangle


def stacked(
    triangles: Sequence[JointTriangle], parameters: int, weights: FloatArray | None = None
) -> FloatArray:
    """R factor (b + 1 columns) of all joints together, joint j multiplied by `weights[j]`."""
    parts = []
    for number, joint in enumerate(triangles):
        wide = spread(joint.triangle, np.append(joint.columns, parameters), parameters + 1)
        parts.append(wide if weights is None else wide * weights[number])
    return r_factor(np.vstack(parts))


def residual_sigma(triangles: Sequence[JointTriangle], values: FloatArray) -> FloatArray:
    """Standard deviation of each joint's residual, (n_joints,) N m.

    The b estimated parameters are charged to the joints in proportion to their rows.
    """
    total = sum(joint.rows for joint in triangles)
    share = max(1.0 - len(values) / total, 1.0 / total)
    sigma = np.empty(len(triangles))
    for number, joint in enumerate(triangles):
        residual = joint.triangle @ np.append(values[joint.columns], -1.0)
        sigma[number] = np.sqrt(float(residual @ residual) / max(joint.rows * share, 1.0))
    return sigma


def unseen_parameters(triangles: Sequence[JointTriangle], parameters: int) -> list[int]:
    """Base parameters whose columns depend on those before them in these rows."""
    triangle = stacked(triangles, parameters)[:, :parameters]
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


def condition_number(triangles: Sequence[JointTriangle], parameters: int) -> float:
    """Condition number of the stacked, unweighted observation matrix X."""
    return float(np.linalg.cond(stacked(triangles, parameters)[:parameters, :parameters]))


def white_covariance(
    triangles: Sequence[JointTriangle], parameters: int, sigma: FloatArray
) -> FloatArray:
    """(XᵀΩ⁻¹X)⁻¹, the covariance (b, b) of weighted least squares with white residuals."""
    triangle = stacked(triangles, parameters, weights=1.0 / sigma)
    root = np.linalg.inv(triangle[:parameters, :parameters])
    return np.asarray(root @ root.T)
