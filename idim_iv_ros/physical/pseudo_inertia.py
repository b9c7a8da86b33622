"""Pseudo-inertias: mass, first moments and second moments of a body in one 4 x 4 matrix.

J = [[½ tr(I) 1 − I, h], [hᵀ, m]] is positive definite for every body of positive density that
fills space, and for no other numbers (Wensing, Kim, Slotine 2018; Traversaro et al. 2016). I: about
the origin of the joint frame; h = m c.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from idim_iv_ros.model import BaseParameters, RobotModel
from idim_iv_ros.model.parameters import INERTIAL
from idim_iv_ros.types import FloatArray, IntArray

# Of the nominal pseudo-inertia a direction is at least this share of the largest of its kind: a
# nominal link that is a point, a rod or a sheet, or has no mass, leaves the others free.
_LEAST_SHARE = 1e-4
_LEAST_VARIANCE = 1e-12  # of a correlation matrix
TRIANGLE = tuple((row, column) for row in range(4) for column in range(row + 1))


def _basis() -> FloatArray:
    """J of each unit parameter: (4, 4, 10) in the order of `INERTIAL`."""
    basis = np.zeros((4, 4, 10))
    for place, name in enumerate(INERTIAL):
        if name == "M":
            basis[3, 3, place] = 1.0
        elif name.startswith("M"):
            axis = "XYZ".index(name[1])
            basis[axis, 3, place] = basis[3, axis, place] = 1.0
        else:
            first, second = ("XYZ".index(letter) for letter in name)
            if first == second:
                basis[(0, 1, 2), (0, 1, 2), place] = 0.5
                basis[first, first, place] = -0.5
            else:
                basis[first, second, place] = basis[second, first, place] = -1.0
    return basis


BASIS = _basis()


def pseudo_inertia(parameters: FloatArray) -> FloatArray:
    """J (4, 4) of XX … M (10,), kg m², kg m, kg."""
    return np.asarray(BASIS @ parameters)


def inertial_parameters(matrix: FloatArray) -> FloatArray:
    """XX … M (10,) of J (4, 4)."""
    second, trace = matrix[:3, :3], float(np.trace(matrix[:3, :3]))
    parameters = np.zeros(10)
    for place, name in enumerate(INERTIAL):
        if name == "M":
            parameters[place] = matrix[3, 3]
        elif name.startswith("M"):
            parameters[place] = matrix["XYZ".index(name[1]), 3]
        else:
            first, second_axis = ("XYZ".index(letter) for letter in name)
            parameters[place] = (trace if first == second_axis else 0.0) - second[
                first, second_axis
            ]
    return parameters


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
        own_mass = matrix[3, 3] if matrix[3, 3] > 0.0 else mass
        centre = matrix[:3, 3] / own_mass
        about_centre = matrix[:3, :3] - own_mass * np.outer(centre, centre)
        values, vectors = np.linalg.eigh(0.5 * (about_centre + about_centre.T))
        # A point mass has the size of a tenth of a link.
        largest = max(float(values[-1]), own_mass * (0.1 * length) ** 2)
        values = np.maximum(values, _LEAST_SHARE * largest)
        shape = upper_root(vectors @ np.diag(values) @ vectors.T)
        factor = np.zeros((4, 4))
        factor[:3, :3] = shape
        factor[:3, 3] = centre * np.sqrt(own_mass)
        factor[3, 3] = np.sqrt(own_mass)
        return cls(factor)

    @cached_property
    def to_parameters(self) -> FloatArray:
        """(10, 10): XX … M of the lower triangle of J̃, row by row."""
        columns = []
        for row, column in TRIANGLE:
            unit = np.zeros((4, 4))
            unit[row, column] = unit[column, row] = 1.0
            columns.append(inertial_parameters(self.factor @ unit @ self.factor.T))
        return np.column_stack(columns)

    def relative(self, parameters: FloatArray) -> FloatArray:
        """J̃ (4, 4) of XX … M (10,): the unit matrix for the nominal link."""
        left = np.linalg.solve(self.factor, pseudo_inertia(parameters))
        return np.linalg.solve(self.factor, left.T).T

    def eigenvalues(self, parameters: FloatArray) -> FloatArray:
        """Of J (4,), kg, ascending; lengths in radii of gyration of the nominal link.

        About the origin of the joint frame.
        """
        radius = float(np.linalg.norm(self.factor[:3])) / self.factor[3, 3]
        scale = np.diag([1.0 / radius, 1.0 / radius, 1.0 / radius, 1.0])
        return np.asarray(np.linalg.eigvalsh(scale @ pseudo_inertia(parameters) @ scale))


def upper_root(matrix: FloatArray) -> FloatArray:
    """U, upper triangular, with U Uᵀ a positive definite matrix.

    Raises
    ------
    numpy.linalg.LinAlgError
        It is not positive definite.
    """
    flipped = np.linalg.cholesky(matrix[::-1, ::-1])
    return np.asarray(flipped[::-1, ::-1])


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
        layout, joints = base.layout, len(robot.joints)
        names = {name: k for k, name in enumerate(layout.names)}
        of_joints = [
            np.array([names[f"{kind}{joint + 1}"] for kind in INERTIAL]) for joint in range(joints)
        ]
        masses = robot.given.inertial[:, 0]
        mass = float(np.mean(masses[masses > 0.0])) if np.any(masses > 0.0) else 1.0
        distances = [
            float(np.linalg.norm(placement.translation))
            for placement in robot.pinocchio.jointPlacements[1:]
        ]
        length = max(float(np.mean(distances)), 0.05)
        bodies = [standard[place] for place in of_joints] + [body for _, body in loads]
        places = (*of_joints, *(of_joints[joint] for joint, _ in loads))
        links = tuple(ReferenceLink.of(body, mass, length) for body in bodies)
        inertial = set(np.concatenate(of_joints).tolist())
        drives = np.array([k for k in range(len(names)) if k not in inertial], dtype=np.int64)
        matrix = np.zeros((len(names), 10 * len(links) + len(drives)))
        for number, (place, link) in enumerate(zip(places, links, strict=True)):
            matrix[place, 10 * number : 10 * number + 10] = link.to_parameters
        matrix[drives, 10 * len(links) + np.arange(len(drives))] = 1.0
        return cls(links, places, drives, matrix)

    @property
    def reference(self) -> FloatArray:
        """X of the reference bodies; drives at zero."""
        x = np.zeros(self.to_standard.shape[1])
        diagonal = [float(row == column) for row, column in TRIANGLE]
        x[: 10 * len(self.links)] = np.tile(diagonal, len(self.links))
        return x


def root_of_information(covariance: FloatArray) -> tuple[IntArray, FloatArray]:
    """Which parameters are shown, and R with RᵀR the inverse of their covariance (b, b)."""
    variance = np.diag(covariance)
    shown = np.flatnonzero(variance > 0.0)
    std = np.sqrt(variance[shown])
    correlation = covariance[np.ix_(shown, shown)] / np.outer(std, std)
    sizes, vectors = np.linalg.eigh(0.5 * (correlation + correlation.T))
    sizes = np.maximum(sizes, _LEAST_VARIANCE * sizes[-1])
    return shown, (vectors / np.sqrt(sizes)).T / std
