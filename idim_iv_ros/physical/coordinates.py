"""Pseudo-inertias over those of reference bodies, and numbers of drives, as one vector."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from idim_iv_ros.model import BaseParameters, RobotModel
from idim_iv_ros.model.parameters import INERTIAL
from idim_iv_ros.physical.conic_problem import TRIANGLE
from idim_iv_ros.physical.pseudo_inertia import ReferenceLink
from idim_iv_ros.types import FloatArray, IntArray

_LEAST_VARIANCE = 1e-12  # of a correlation matrix


@dataclass(frozen=True)
class Coordinates:
    """Standard parameters π = T x, x the triangles of all J̃, then drives and friction.

    Attributes
    ----------
    links : tuple of ReferenceLink
        One for each joint, then one for each load.
    places : tuple of (10,)
        Which standard parameters each of them is part of.
    drives : (k,)
        Standard parameters of drives and friction.
    to_standard : (p, 10 n + k)
        T.
    """

    links: tuple[ReferenceLink, ...]
    places: tuple[IntArray, ...]
    drives: IntArray
    to_standard: FloatArray

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
