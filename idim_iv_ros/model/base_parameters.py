"""Base parameters: the fewest from which the inverse dynamic model follows (section II.B)."""

from collections.abc import Collection
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from idim_iv_ros.model.parameters import ParameterLayout
from idim_iv_ros.model.regressor import StandardRegressor
from idim_iv_ros.types import BoolArray, FloatArray, IntArray

# A column is eliminated when less than this share of it is independent of the columns before.
TOLERANCE = 1e-6
# Standard parameters that no body, drive or friction has below zero.
NON_NEGATIVE = frozenset({"XX", "YY", "ZZ", "M", "Ia", "Fv", "Fc", "Fvm", "Fcm"})
_SAMPLES_PER_PARAMETER = 2
_SEED = 20170401
_BLOCK = 64  # states whose regressor is held at once


@dataclass(frozen=True)
class BaseParameters:
    """The base set and how it groups the standard parameters."""

    layout: ParameterLayout
    columns: IntArray  # (b,): standard parameters that are kept, and give their groups the name
    grouping: FloatArray  # (b, n_standard): β_base = grouping · β_standard
    active: BoolArray  # (n_joints, b): whether the torque of a joint depends on a base parameter

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the base parameters."""
        return tuple(self.layout.names[column] for column in self.columns)

    @cached_property
    def units(self) -> tuple[str, ...]:
        """Units of the base parameters."""
        return tuple(self.layout.parameters[column].unit for column in self.columns)

    @cached_property
    def expressions(self) -> tuple[str, ...]:
        """Grouped expressions, e.g. ``XX2 - YY2 - 0.050625 M3``."""
        expressions, names = [], self.layout.names
        for column, row in zip(self.columns, self.grouping, strict=True):
            text = names[column]
            for other in np.flatnonzero(row):
                if other != column:
                    size = f"{abs(row[other]):.6g}"
                    factor = "" if size == "1" else f"{size} "
                    text += f" {'-' if row[other] < 0 else '+'} {factor}{names[other]}"
            expressions.append(text)
        return tuple(expressions)

    @cached_property
    def non_negative(self) -> tuple[bool, ...]:
        """Whether physics forbids a base parameter to be negative.

        It groups standard parameters that are not negative, none of them with a minus.
        """
        kinds = [parameter.kind in NON_NEGATIVE for parameter in self.layout.parameters]
        allowed = (self.grouping == 0.0) | ((self.grouping > 0.0) & kinds)
        return tuple(allowed.all(axis=1).tolist())

    def from_standard(self, standard: FloatArray) -> FloatArray:
        """Values of the base parameters (b,) of a standard vector (n_standard,)."""
        return np.asarray(self.grouping @ standard)

    def to_standard(self, base: FloatArray) -> FloatArray:
        """Return a standard vector with the same dynamics: eliminated parameters are zero."""
        standard = np.zeros(len(self.layout.parameters))
        standard[self.columns] = base
        return standard

    def without(self, names: Collection[str]) -> "BaseParameters":
        """Base parameters without some of them, which are zero in the reduced model."""
        kept = np.array([name not in names for name in self.names], dtype=bool)
        return replace(
            self,
            columns=self.columns[kept],
            grouping=self.grouping[kept],
            active=self.active[:, kept],
        )


def find_base_parameters(regressor: StandardRegressor) -> BaseParameters:
    """Find the base set by QR elimination with the order of the columns kept.

    The regressor is evaluated at states drawn within the joint limits with a fixed seed. A column
    that depends on the columns before it is eliminated and grouped into them, so that the set
    and its expressions do not depend on pivoting and are the same on every machine.
    """
    layout = regressor.layout
    rows, squares, largest = _random_rows(regressor)
    norms = np.sqrt(squares)
    shown = np.flatnonzero(norms > TOLERANCE * norms.max())
    scale = np.linalg.norm(rows[:, shown], axis=0)
    independent, basis = independent_columns(rows[:, shown] / scale, TOLERANCE)
    columns = shown[independent]
    grouping = np.linalg.solve(basis.T @ rows[:, columns], basis.T @ rows)
    grouping[:, columns] = np.eye(len(columns))
    grouping[:, norms <= TOLERANCE * norms.max()] = 0.0
    # A coefficient that is rounding on the scale of what the two columns contribute is none.
    contribution = np.abs(grouping) * norms[columns][:, None]
    grouping[contribution <= 1e-5 * np.maximum(norms, norms.max() * 1e-9)] = 0.0
    active = largest[:, columns] > TOLERANCE * norms[columns] / len(rows)
    return BaseParameters(layout, columns, np.round(grouping, 9), active)


def _random_rows(regressor: StandardRegressor) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Rows (n_states, n_standard) of the regressor at random states, mixtures of the joints'.

    Mixtures show every dependence of the columns that the rows themselves show, with a row for a
    state instead of one for a joint. With them: squares (n_standard,) of the columns over all rows,
    and the largest magnitudes (n_joints, n_standard) by joint.
    """
    joints, parameters = len(regressor.robot.order), len(regressor.layout.parameters)
    random, limits = np.random.default_rng(_SEED), regressor.robot.limits
    shape = (max(50, _SAMPLES_PER_PARAMETER * parameters), joints)
    lower, upper = np.maximum(limits.lower, -np.pi), np.minimum(limits.upper, np.pi)
    narrow = ~(lower < upper)
    lower, upper = np.where(narrow, -np.pi, lower), np.where(narrow, np.pi, upper)
    q = lower + (upper - lower) * random.random(shape)
    states = (q, random.uniform(-2.0, 2.0, shape), random.uniform(-10.0, 10.0, shape))
    mixture = np.random.default_rng(_SEED + 1).standard_normal(shape)
    rows = np.empty((len(mixture), parameters))
    squares, largest = np.zeros(parameters), np.zeros((joints, parameters))
    for start in range(0, len(rows), _BLOCK):
        block = slice(start, start + _BLOCK)
        matrix = regressor(*(state[block] for state in states))
        rows[block] = np.einsum("sj,sjp->sp", mixture[block], matrix)
        squares += np.einsum("sjp,sjp->p", matrix, matrix)
        np.maximum(largest, np.abs(matrix).max(axis=0), out=largest)
    return rows, squares, largest


def independent_columns(columns: FloatArray, tolerance: float) -> tuple[IntArray, FloatArray]:
    """Eliminate the columns that those before them explain: Gram-Schmidt without pivoting.

    Columns (r, c) are of norm one, or zero; one counts if more than `tolerance` is left of it.

    Returns kept (rank,) int, increasing; basis (r, rank): orthonormal, of their span.
    """
    rows, count = columns.shape
    basis = np.empty((rows, min(rows, count)), order="F")
    kept: list[int] = []
    for column in range(count):
        direction, before = columns[:, column], basis[:, : len(kept)]
        for _ in range(2):  # twice is enough for orthogonality to rounding
            direction = direction - before @ (before.T @ direction)
        left = float(np.linalg.norm(direction))
        if left > tolerance and len(kept) < basis.shape[1]:
            basis[:, len(kept)] = direction / left
            kept.append(column)
    return np.array(kept, dtype=np.int64), basis[:, : len(kept)]
