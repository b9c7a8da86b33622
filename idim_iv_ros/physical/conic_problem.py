"""The semidefinite problem behind the nearest physical parameters, for the solver clarabel.

    min ‖A x − a‖² + Σ_i λ_i (tr J̃_i − log det J̃_i) + Σ_k ((d_k − d_k⁰) / s_k)²
    subject to J̃_i ≽ ε 1, d_k ≥ 0 where physics says so.

x holds the lower triangles of all J̃ (pseudo-inertias over the nominal ones), then the parameters d
of drives and friction. clarabel knows quadratic objectives and the cones of semidefinite matrices
and of exponentials, so that it is given the problem itself: no modelling language, whose
import and compilation would take ten times as long as the solution. log det J̃ ≥ Σ t_k holds where
[[J̃, Z], [Zᵀ, diag Z]] is positive semidefinite with Z lower triangular and t_k ≤ log Z_kk.
"""

from collections.abc import Callable
from dataclasses import dataclass
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from idim_iv_ros.errors import DataError
from idim_iv_ros.physical.pseudo_inertia import TRIANGLE
from idim_iv_ros.types import FloatArray

_SIZE = len(TRIANGLE)
_TOLERANCE = 1e-10  # of the solver; a solution that misses it is taken if it is within 1e-5
_ROOT = float(np.sqrt(2.0))


@dataclass(frozen=True)
class ConicProblem:
    """See the module."""

    matrix: FloatArray  # (r, 10 n + k): A
    right: FloatArray  # (r,): a
    links: int  # n
    # nominal, scale: (k,): d⁰ and s; a scale of infinity leaves a parameter to the data
    nominal: FloatArray
    scale: FloatArray
    bounded: NDArray[np.bool_]  # (k,) bool: which of d are not negative
    weights: FloatArray  # (n,): λ of each link
    least: float  # ε

    def solve(self) -> FloatArray:
        """(10 n + k,) x.

        Raises
        ------
        DataError
            The solver found no solution.
        ImportError
            clarabel is not installed.
        """
        import clarabel

        rows = _Rows(self._variables)
        shown, unknowns = self.matrix.shape
        rows.equal(np.hstack([self.matrix, -np.eye(shown)]), self.right)
        for k in np.flatnonzero(self.bounded):
            rows.not_negative(_SIZE * self.links + int(k))
        for link in range(self.links):
            self._link(rows, link)
        quadratic, linear = self._objective(unknowns, shown)
        settings = clarabel.DefaultSettings()
        settings.verbose = False
        settings.max_threads = 1
        # The large matrix of a link taken apart into cliques stalls: four of 200 recordings.
        settings.chordal_decomposition_enable = False
        settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = _TOLERANCE
        matrix, right, cones = rows.build(clarabel)
        solver = clarabel.DefaultSolver(quadratic, linear, matrix, right, cones, settings)
        solution = solver.solve()
        if str(solution.status) not in ("Solved", "AlmostSolved"):
            raise DataError(
                "no masses and inertias of real bodies come near the estimates "
                f"(clarabel: {solution.status})"
            )
        return np.asarray(solution.x)[:unknowns]

    @property
    def _variables(self) -> int:
        shown, unknowns = self.matrix.shape
        return int(unknowns + shown + self.links * (_SIZE + 4))

    def _objective(self, unknowns: int, shown: int) -> tuple[sparse.csc_matrix, FloatArray]:
        """P and q of ½ xᵀ P x + qᵀ x."""
        diagonal, linear = np.zeros(self._variables), np.zeros(self._variables)
        diagonal[unknowns : unknowns + shown] = 2.0
        start = _SIZE * self.links
        weight = 2.0 / self.scale**2
        diagonal[start:unknowns] = weight
        linear[start:unknowns] = -weight * self.nominal
        for link, divergence in enumerate(self.weights):
            for place, (row, column) in enumerate(TRIANGLE):
                if row == column:
                    linear[_SIZE * link + place] = divergence
            logarithms = unknowns + shown + link * (_SIZE + 4) + _SIZE
            linear[logarithms : logarithms + 4] = -divergence
        return sparse.diags(diagonal, format="csc"), linear

    def _link(self, rows: "_Rows", link: int) -> None:
        """J̃ ≽ ε 1, and its log det."""
        shown, unknowns = self.matrix.shape
        first, roots = _SIZE * link, unknowns + shown + link * (_SIZE + 4)
        place = {pair: k for k, pair in enumerate(TRIANGLE)}

        def entry(row: int, column: int) -> int | None:
            """Variable at an entry of the large matrix, row ≤ column; None where it is zero."""
            if column < 4:
                return first + place[column, row]
            if row < 4:  # Z, lower triangular
                return roots + place[row, column - 4] if row >= column - 4 else None
            return roots + place[row - 4, row - 4] if row == column else None

        rows.semidefinite(4, entry, -self.least)
        rows.semidefinite(8, entry, 0.0)
        for k in range(4):
            rows.exponential(roots + _SIZE + k, roots + place[k, k])


class _Rows:
    """Rows of b − A x in cones, gathered one after the other."""

    def __init__(self, variables: int):
        self.variables = variables
        self.values: list[float] = []
        self.rows: list[int] = []
        self.columns: list[int] = []
        self.right: list[float] = []
        self.cones: list[tuple[str, int]] = []

    def equal(self, matrix: FloatArray, right: FloatArray) -> None:
        """The matrix times the first variables is `right`."""
        for values, value in zip(matrix, right, strict=True):
            for column in np.flatnonzero(values):
                self._put(int(column), float(values[column]))
            self.right.append(float(value))
        self.cones.append(("ZeroConeT", len(right)))

    def not_negative(self, variable: int) -> None:
        """The variable is not below zero."""
        self._put(variable, -1.0)
        self.right.append(0.0)
        self.cones.append(("NonnegativeConeT", 1))

    def semidefinite(
        self, size: int, entry: Callable[[int, int], int | None], diagonal: float
    ) -> None:
        """The matrix of variables, plus `diagonal` times 1: its upper triangle, by columns."""
        for column in range(size):
            for row in range(column + 1):
                variable = entry(row, column)
                if variable is not None:
                    self._put(variable, -1.0 if row == column else -_ROOT)
                self.right.append(diagonal if row == column else 0.0)
        self.cones.append(("PSDTriangleConeT", size))

    def exponential(self, logarithm: int, argument: int) -> None:
        """(t, 1, z) with exp t ≤ z."""
        self._put(logarithm, -1.0)
        self.right += [0.0, 1.0]
        self._put(argument, -1.0)
        self.right.append(0.0)
        self.cones.append(("ExponentialConeT", 0))

    def _put(self, column: int, value: float) -> None:
        """A coefficient of the row that is next in `right`."""
        self.rows.append(len(self.right))
        self.columns.append(column)
        self.values.append(value)

    def build(self, clarabel: ModuleType) -> tuple[sparse.csc_matrix, FloatArray, list[Any]]:
        """A, b and the cones."""
        shape = (len(self.right), self.variables)
        matrix = sparse.csc_matrix((self.values, (self.rows, self.columns)), shape=shape)
        cones = [
            getattr(clarabel, name)(size) if size else getattr(clarabel, name)()
            for name, size in self.cones
        ]
        return matrix, np.array(self.right), cones
