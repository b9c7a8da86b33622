"""Pseudo-inertias: mass, first moments and second moments of a body in one 4 x 4 matrix.

J = [[½ tr(I) 1 − I, h], [hᵀ, m]] is positive definite for every body of positive density that
fills space, and for no other numbers (Wensing, Kim, Slotine 2018; Traversaro et al. 2016). I: about
the origin of the joint frame; h = m c.

`ConicProblem` is the semidefinite problem behind the nearest physical parameters:

    min ‖A x − a‖² + Σ_i λ_i (tr J̃_i − log det J̃_i) + Σ_k ((d_k − d_k⁰) / s_k)²
    subject to J̃_i ≽ ε 1, d_k ≥ 0 where physics says so.

x holds the lower triangles of all J̃ (pseudo-inertias over the nominal ones), then the parameters d
of drives and friction. clarabel knows quadratic objectives and the cones of semidefinite matrices
and of exponentials, so that it is given the problem itself: no modelling language, whose
import and compilation would take ten times as long as the solution. log det J̃ ≥ Σ t_k holds where
[[J̃, Z], [Zᵀ, diag Z]] is positive semidefinite with Z lower triangular and t_k ≤ log Z_kk.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import sparse

from idim_iv_ros.errors import DataError
from idim_iv_ros.model import BaseParameters, RobotModel
from idim_iv_ros.types import BoolArray, FloatArray, IntArray

# ε: what a link has at least of its nominal pseudo-inertia in every direction.
LEAST_OF_NOMINAL = 1e-3
# Of the nominal pseudo-inertia a direction is at least this share of the largest of its kind: a
# nominal link that is a point, a rod or a sheet, or has no mass, leaves the others free.
_LEAST_SHARE = 1e-4
_LEAST_VARIANCE = 1e-12  # of a correlation matrix
TRIANGLE = tuple((row, column) for row in range(4) for column in range(row + 1))
UNITS = np.zeros((10, 4, 4))  # symmetric matrices that `TRIANGLE` lists the entries of
for _place, (_row, _column) in enumerate(TRIANGLE):
    UNITS[_place, _row, _column] = UNITS[_place, _column, _row] = 1.0


def pseudo_inertia(parameters: FloatArray) -> FloatArray:
    """Pseudo-inertia J (4, 4) of a body's parameters XX … M (10,), kg m², kg m, kg."""
    xx, xy, xz, yy, yz, zz, x, y, z, mass = parameters
    half = 0.5 * (xx + yy + zz)
    rows = [[half - xx, -xy, -xz, x], [-xy, half - yy, -yz, y], [-xz, -yz, half - zz, z]]
    return np.array([*rows, [x, y, z, mass]])


def inertial_parameters(matrix: FloatArray) -> FloatArray:
    """Parameters XX … M (10,) of a body with the pseudo-inertia J (4, 4)."""
    inertia = np.trace(matrix[:3, :3]) * np.eye(3) - matrix[:3, :3]
    return np.concatenate([inertia[np.triu_indices(3)], matrix[:, 3]])


@dataclass(frozen=True)
class ReferenceLink:
    """A nominal link as the unit in which its pseudo-inertia is counted: J = F J̃ Fᵀ, J₀ = F Fᵀ."""

    factor: FloatArray  # (4, 4): F, upper triangular: it maps bodies affinely

    @classmethod
    def of(cls, given: FloatArray, mass: float, length: float) -> "ReferenceLink":
        """Take the nominal link, with what it lacks of a body.

        - `given`: (10,), XX … M of the nominal model; zero where it gives none
        - `mass`, `length`: of a link of this robot, kg and m, where the link itself does not say
        """
        matrix = pseudo_inertia(given)
        link_mass = matrix[3, 3] if matrix[3, 3] > 0.0 else mass
        centre = matrix[:3, 3] / link_mass
        about_centre = matrix[:3, :3] - link_mass * np.outer(centre, centre)
        values, vectors = np.linalg.eigh(0.5 * (about_centre + about_centre.T))
        # A point mass has the size of a tenth of a link.
        largest = max(float(values[-1]), link_mass * (0.1 * length) ** 2)
        values = np.maximum(values, _LEAST_SHARE * largest)
        shape = upper_root(vectors @ np.diag(values) @ vectors.T)
        factor = np.zeros((4, 4))
        factor[:3, :3] = shape
        factor[:3, 3] = centre * np.sqrt(link_mass)
        factor[3, 3] = np.sqrt(link_mass)
        return cls(factor)

    @cached_property
    def to_parameters(self) -> FloatArray:
        """(10, 10): XX … M of the lower triangle of J̃, row by row."""
        bodies = (self.factor @ unit @ self.factor.T for unit in UNITS)
        return np.column_stack([inertial_parameters(body) for body in bodies])

    def relative(self, parameters: FloatArray) -> FloatArray:
        """J̃ (4, 4) of XX … M (10,): the unit matrix for the nominal link."""
        left = np.linalg.solve(self.factor, pseudo_inertia(parameters))
        return np.linalg.solve(self.factor, left.T).T

    def eigenvalues(self, parameters: FloatArray) -> FloatArray:
        """Eigenvalues of J (4,), kg, ascending; lengths in nominal radii of gyration."""
        radius = float(np.linalg.norm(self.factor[:3])) / self.factor[3, 3]
        scale = np.diag([1.0 / radius, 1.0 / radius, 1.0 / radius, 1.0])
        return np.asarray(np.linalg.eigvalsh(scale @ pseudo_inertia(parameters) @ scale))


def upper_root(matrix: FloatArray) -> FloatArray:
    """U, upper triangular, with U Uᵀ a positive definite matrix.

    Raises numpy.linalg.LinAlgError: it is not positive definite.
    """
    return np.asarray(np.linalg.cholesky(matrix[::-1, ::-1])[::-1, ::-1])


@dataclass(frozen=True)
class Coordinates:
    """Standard parameters π = T x, x the triangles of all J̃, then drives and friction."""

    links: tuple[ReferenceLink, ...]  # One for each joint, then one for each load
    places: tuple[IntArray, ...]  # Which standard parameters each of them is part of
    drives: IntArray  # (k,): standard parameters of drives and friction
    to_standard: FloatArray  # (p, 10 n + k): T

    @classmethod
    def of(
        cls,
        robot: RobotModel,
        base: BaseParameters,
        standard: FloatArray,
        loads: Sequence[tuple[int, FloatArray]] = (),
    ) -> "Coordinates":
        """Take links (p,), and loads by the place of their joint, XX … M (10,), as references."""
        of_joints = base.layout.of_bodies
        masses = robot.given.inertial[:, 0]
        mass = float(np.mean(masses[masses > 0.0])) if np.any(masses > 0.0) else 1.0
        ways = [placement.translation for placement in robot.pinocchio.jointPlacements[1:]]
        length = max(float(np.mean(np.linalg.norm(ways, axis=1))), 0.05)
        bodies = [standard[place] for place in of_joints] + [body for _, body in loads]
        places = (*of_joints, *(of_joints[joint] for joint, _ in loads))
        links = tuple(ReferenceLink.of(body, mass, length) for body in bodies)
        drives = np.setdiff1d(np.arange(len(standard)), of_joints)
        matrix = np.zeros((len(standard), 10 * len(links) + len(drives)))
        for number, (place, link) in enumerate(zip(places, links, strict=True)):
            matrix[place, 10 * number : 10 * number + 10] = link.to_parameters
        matrix[drives, 10 * len(links) + np.arange(len(drives))] = 1.0
        return cls(links, places, drives, matrix)

    @property
    def reference(self) -> FloatArray:
        """Coordinates x (10 n + k,) of the reference bodies, with drives at zero."""
        bodies = np.tile([float(row == column) for row, column in TRIANGLE], len(self.links))
        return np.pad(bodies, (0, len(self.drives)))


def root_of_information(covariance: FloatArray) -> tuple[IntArray, FloatArray]:
    """Which parameters are shown, and R with RᵀR the inverse of their covariance (b, b)."""
    variance = np.diag(covariance)
    shown = np.flatnonzero(variance > 0.0)
    std = np.sqrt(variance[shown])
    correlation = covariance[np.ix_(shown, shown)] / np.outer(std, std)
    sizes, vectors = np.linalg.eigh(0.5 * (correlation + correlation.T))
    sizes = np.maximum(sizes, _LEAST_VARIANCE * sizes[-1])
    return shown, (vectors / np.sqrt(sizes)).T / std


_SIZE = len(TRIANGLE)
_TOLERANCE = 1e-10  # of the solver; a solution that misses it is taken if it is within 1e-5
_ROOT = float(np.sqrt(2.0))
_Row = tuple[dict[int, float], float]  # factors by variable, and right side


@dataclass(frozen=True)
class ConicProblem:
    """The semidefinite problem at the head of this module, with its names."""

    matrix: FloatArray  # (r, 10 n + k): A
    right: FloatArray  # (r,): a
    nominal: FloatArray  # (k,): d⁰
    scale: FloatArray  # (k,): s; infinity leaves a parameter to the data
    bounded: BoolArray  # (k,): which of d are not negative
    weights: FloatArray  # (n,): λ of each link

    def solve(self) -> FloatArray:
        """Return the x (10 n + k,) that solves the problem.

        Raises DataError: the solver found no solution; ImportError: clarabel is not installed.
        """
        import clarabel

        shown, unknowns = self.matrix.shape
        links = len(self.weights)
        start, variables = _SIZE * links, unknowns + shown + links * (_SIZE + 4)
        # The objective ½ xᵀ P x + qᵀ x in all variables, P diagonal.
        diagonal, linear = np.zeros((2, variables))
        diagonal[unknowns : unknowns + shown] = 2.0
        weight = 2.0 / self.scale**2
        diagonal[start:unknowns] = weight
        linear[start:unknowns] = -weight * self.nominal
        traces = np.array([row == column for row, column in TRIANGLE])
        linear[:start] = np.outer(self.weights, traces).ravel()
        logarithms = np.repeat([0.0, 1.0], [_SIZE, 4])
        linear[unknowns + shown :] = -np.outer(self.weights, logarithms).ravel()
        # Rows of b − A x in cones below the equations, one below the other.
        bounded = (start + np.flatnonzero(self.bounded)).tolist()
        rows: list[_Row] = [({variable: -1.0}, 0.0) for variable in bounded]
        cones = [clarabel.ZeroConeT(shown)]
        cones += [clarabel.NonnegativeConeT(1) for _ in bounded]
        for link in range(links):
            rows += self._link(link)
            cones += [clarabel.PSDTriangleConeT(4), clarabel.PSDTriangleConeT(8)]
            cones += [clarabel.ExponentialConeT() for _ in range(4)]
        right = np.concatenate([self.right, [value for _, value in rows]])
        entries = [(k, *one) for k, (factors, _) in enumerate(rows) for one in factors.items()]
        table = np.array(entries, dtype=float).reshape(-1, 3)
        equal = sparse.csc_matrix(np.hstack([self.matrix, -np.eye(shown)]))
        equal.resize(shown, variables)
        places = table[:, :2].T.astype(int)
        inside = sparse.csc_matrix((table[:, 2], places), shape=(len(rows), variables))
        matrix = sparse.vstack([equal, inside], format="csc")
        settings = clarabel.DefaultSettings()
        settings.verbose = False
        settings.max_threads = 1
        # The large matrix of a link taken apart into cliques stalls: four of 200 recordings.
        settings.chordal_decomposition_enable = False
        settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = _TOLERANCE
        problem = (sparse.diags(diagonal, format="csc"), linear, matrix, right, cones, settings)
        solution = clarabel.DefaultSolver(*problem).solve()
        if str(solution.status) not in ("Solved", "AlmostSolved"):
            raise DataError(
                "no masses and inertias of real bodies come near the estimates "
                f"(clarabel: {solution.status})"
            )
        return np.asarray(solution.x)[:unknowns]

    def _link(self, link: int) -> Iterator[_Row]:
        """Constraints of a link: J̃ ≽ ε 1, and the variables whose sum is log det J̃."""
        shown, unknowns = self.matrix.shape
        first, roots = _SIZE * link, unknowns + shown + link * (_SIZE + 4)
        # Variables at the entries of the large matrix, row ≤ column; -1 where it is zero.
        large = np.full((8, 8), -1)
        for k, (row, column) in enumerate(TRIANGLE):  # J̃ is symmetric, and Z lower triangular
            large[column, row], large[row, 4 + column] = first + k, roots + k
        diagonal = range(4, 8)
        large[diagonal, diagonal] = large[range(4), diagonal]
        for size, least in ((4, -LEAST_OF_NOMINAL), (8, 0.0)):
            for column in range(size):
                for row, variable in enumerate(large[: column + 1, column].tolist()):
                    factor = -1.0 if row == column else -_ROOT
                    yield {variable: factor} if variable >= 0 else {}, least * (row == column)
        for k, root in zip(range(4), large[diagonal, diagonal].tolist(), strict=True):
            yield {roots + _SIZE + k: -1.0}, 0.0  # t ≤ log z
            yield {}, 1.0
            yield {root: -1.0}, 0.0
