"""What no cause explains of an estimate, spread over links and drives as far as it asks for it.

Each link, and the drive and friction of each joint, may be off by a relative size of its own, a
normal prior about the nominal model with the causes. The sizes have maximum evidence (automatic
relevance determination: MacKay 1992, Tipping 2001), so that most are zero and the nominal
numbers stay. With these sizes the spread is the maximum of the posterior,

    min ‖R(Kπ − β̂)‖² + Σ_i 2/w_i² [tr J̃_i − log det J̃_i] + Σ_k ((d_k − d_k⁰) / s_k)²,

whose divergence is to second order the normal prior of pseudo-inertias of size w_i. What a cause
names, and the bodies of loads, are left to the estimate.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from idim_iv_ros.model import BaseParameters, RobotModel
from idim_iv_ros.physical.nearest import AT_ZERO, not_negative, smallest_std
from idim_iv_ros.physical.pseudo_inertia import (
    TRIANGLE,
    ConicProblem,
    Coordinates,
    root_of_information,
)
from idim_iv_ros.types import FloatArray, IntArray

# What the numbers of a nominal link are usually off by, and the most that evidence may ask for.
USUAL_ERROR = 0.1
_FREE = 1.0  # relative size of what is left to the estimate
_LEAST = 1e-3  # a size below it is none
_LEAST_OF_UNSHOWN = 0.01  # what a nominal number that no motion shows is off by, at least
_CONVERGED = 1e-4
_MOST_STEPS = 300


@dataclass(frozen=True)
class Remainder:
    """Numbers of links, loads and drives of greatest posterior probability, and what they may be.

    The estimate leaves open one relative size for all links and one for all drives, of maximum
    evidence and at least 1 %: links of one nominal model are about as good, also those that no
    motion shows.
    """

    standard: FloatArray  # (p,): standard parameters of the robot without its loads
    loads: tuple[FloatArray, ...]  # XX … M of each
    # (n_joints,) each: relative sizes w that the estimate asks for; zero where the nominal numbers
    # stay
    links: FloatArray
    drives: FloatArray
    coordinates: Coordinates  # Links and loads of the maximum as references
    # (q, q): lower triangular; root @ root.T is the covariance of x of these coordinates
    root: FloatArray
    open_links: float  # One relative size that is left open for all links
    open_drives: float  # The same for all drives


@dataclass(frozen=True)
class _Prior:
    """Normal about the model with the causes: relative sizes of groups times unit variances."""

    groups: IntArray  # (q,): links, then drives of joints
    units: FloatArray  # (q,)
    free: NDArray[np.bool_]  # (q,)

    def variances(self, sizes: FloatArray) -> FloatArray:
        """Prior variances (q,) of all coordinates at relative sizes of their groups."""
        return np.asarray(self.units * np.where(self.free, _FREE, sizes[self.groups]) ** 2)


def spread_remainder(
    robot: RobotModel,
    base: BaseParameters,
    estimate: FloatArray,
    covariance: FloatArray,
    standard: FloatArray,
    loads: Sequence[tuple[int, FloatArray]],
    named: Collection[str],
    unbounded: Collection[str],
) -> Remainder:
    """Find the model with the causes that the estimate asks for.

    - `estimate`, `covariance`: (b,), (b, b), base parameters; rows of zeros are not shown
    - `standard`: (p,), of the nominal model with the causes, but for loads
    - `loads`: the place of the joint that carries each, and XX … M (10,) of it
    - `named`: standard parameters that a cause names
    - `unbounded`: friction parameters that may be below zero, because an effect shares them

    Raises DataError: the solver found none; ImportError: clarabel is not installed.
    """
    joints = len(robot.joints)
    coordinates = Coordinates.of(robot, base, standard, loads)
    shown, root = root_of_information(covariance)
    grouping = root @ base.grouping[shown]
    whole = standard.copy()
    for joint, body in loads:
        whole[coordinates.places[joint]] += body
    missing = root @ estimate[shown] - grouping @ whole
    matrix = grouping @ coordinates.to_standard
    prior = _prior(base, coordinates, standard, estimate, named, joints)
    sizes = _sizes(matrix, missing, prior, 2 * joints)
    variances = prior.variances(sizes)
    moved, bodies = variances > 0.0, 10 * len(coordinates.links)
    start = coordinates.reference
    start[bodies:] = standard[coordinates.drives]
    drives = moved[bodies:]
    places = coordinates.drives[drives]
    bounded = not_negative(base, places, unbounded) & (standard[places] >= 0.0)
    problem = ConicProblem(
        matrix=matrix[:, moved],
        right=missing + matrix[:, moved] @ start[moved],
        nominal=start[bodies:][drives],
        scale=np.sqrt(variances[bodies:][drives]),
        bounded=bounded,
        weights=2.0 / variances[:bodies:10][moved[:bodies:10]],
    )
    x = start.copy()
    x[moved] = problem.solve()
    std = smallest_std(base, coordinates.drives, np.sqrt(np.diag(covariance)))
    for place in np.flatnonzero(drives)[bounded]:
        if x[bodies + place] < AT_ZERO * std[place]:
            x[bodies + place] = 0.0
    change = x - start
    change[10 * joints : bodies] = 0.0  # loads are bodies of their own
    most_likely = standard + coordinates.to_standard @ change
    pairs = zip(coordinates.links[joints:], x[10 * joints : bodies].reshape(-1, 10), strict=True)
    estimated = tuple(np.asarray(link.to_parameters @ triangle) for link, triangle in pairs)
    carried = [(joint, body) for (joint, _), body in zip(loads, estimated, strict=True)]
    after = Coordinates.of(robot, base, most_likely, carried)
    # The uncertainty of the posterior, in coordinates whose references are the maximum.
    shared = replace(prior, groups=prior.groups // joints)
    link, drive = common = np.maximum(_sizes(matrix, missing, shared, 2), _LEAST_OF_UNSHOWN)
    deviations = np.sqrt(shared.variances(common))
    _, singular, directions = np.linalg.svd(matrix * deviations)
    left = np.ones(len(deviations))
    left[: len(singular)] = 1.0 / np.sqrt(1.0 + singular**2)
    spread = deviations[:, None] * directions.T * left
    for number, (old, new) in enumerate(zip(coordinates.links, after.links, strict=True)):
        rows = slice(10 * number, 10 * number + 10)
        spread[rows] = np.linalg.solve(new.to_parameters, old.to_parameters @ spread[rows])
    return Remainder(
        standard=most_likely,
        loads=estimated,
        links=sizes[:joints],
        drives=sizes[joints:],
        coordinates=after,
        root=lower_root(spread),
        open_links=float(link),
        open_drives=float(drive),
    )


def lower_root(root: FloatArray) -> FloatArray:
    """(r, r) lower triangular, of the same covariance as (r, q)."""
    return np.asarray(np.transpose(np.linalg.qr(root.T, mode="r")))


def _prior(
    base: BaseParameters,
    coordinates: Coordinates,
    standard: FloatArray,
    estimate: FloatArray,
    named: Collection[str],
    joints: int,
) -> _Prior:
    """Prior of links by their pseudo-inertia, of drives by value, at least the median of a kind."""
    parameters = base.layout.parameters
    triangle = np.array([1.0 if row == column else 0.5 for row, column in TRIANGLE])
    bodies = len(coordinates.links)
    loose = [
        body >= joints or any(base.layout.names[k] in named for k in place)
        for body, place in enumerate(coordinates.places)
    ]
    drives = [parameters[k] for k in coordinates.drives]
    size = np.abs(standard[coordinates.drives])
    kinds = np.array([drive.kind.removesuffix("m") for drive in drives])
    for kind in ("Ia", "Fv", "Fc"):
        values = size[kinds == kind]
        if np.any(values):
            size[kinds == kind] = np.maximum(values, np.median(values[values > 0.0]))
    # A constant torque by the dry friction; what the nominal model lacks by what is found.
    size[kinds == "off"] = np.median(size[kinds == "Fc"]) if np.any(kinds == "Fc") else 0.0
    estimated = np.abs(np.linalg.pinv(base.grouping) @ estimate)[coordinates.drives]
    size = np.where(size > 0.0, size, np.maximum(estimated, np.finfo(float).tiny))
    of_bodies = np.repeat(np.minimum(np.arange(bodies), joints - 1), 10)
    of_drives = joints + np.array([drive.joint for drive in drives], dtype=np.int64)
    return _Prior(
        groups=np.concatenate([of_bodies, of_drives]),
        units=np.concatenate([np.tile(triangle, bodies), size**2]),
        free=np.concatenate([np.repeat(loose, 10), [drive.name in named for drive in drives]]),
    )


def _sizes(matrix: FloatArray, missing: FloatArray, prior: _Prior, groups: int) -> FloatArray:
    """Relative sizes (groups,) of maximum evidence; `missing`: R(β̂ − Kπ) of the model."""
    sizes = np.full(groups, USUAL_ERROR)
    most = np.where(np.arange(groups) < groups // 2, USUAL_ERROR, 1.0)
    sizes[np.bincount(prior.groups[~prior.free], minlength=groups) == 0] = 0.0  # without a prior
    for _ in range(_MOST_STEPS):
        variances = prior.variances(sizes)
        spread = np.linalg.inv(np.eye(len(missing)) + (matrix * variances) @ matrix.T)
        change = variances * (matrix.T @ (spread @ missing))
        shown = variances * np.einsum("ij,ij->j", matrix, spread @ matrix)
        present = (variances > 0.0) & ~prior.free
        squares = np.zeros(len(change))
        squares[present] = change[present] ** 2 / variances[present]
        of_group = [
            np.bincount(prior.groups[present], values[present], minlength=groups)
            for values in (squares, shown)
        ]
        factor = np.sqrt(of_group[0] / np.maximum(of_group[1], np.finfo(float).tiny))
        new = np.asarray(np.minimum(sizes * factor, most))
        new[new < _LEAST] = 0.0
        if np.abs(new - sizes).max() < _CONVERGED:
            return new
        sizes = new
    return sizes
