"""Estimates of causes beside errors of all other given numbers, which no cause names.

A nominal model is off everywhere by a little. Beside a payload of 1.5 kg, inertials that are wrong
by ten percent move its mass by far more than the noise does. They are random effects here,

    y − X β₀ = D θ + X G S u + e,   u ~ N(0, ρ²),

G the grouping of standard into base parameters, S the changes of standard parameters that are
errors of size one: the mass of the last link, which no torque tells from a payload's, is off like
that of any other. Links have one relative error ρ, drives and friction another. θ comes from
generalised least squares, averaged over what both may be, by their restricted likelihood
and what is usual of nominal models.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin
import scipy

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.parametric.change_regression import ChangeRegression
from idim_iv_ros.effects.parametric_effect import Change, Estimated
from idim_iv_ros.model import DynamicParameters, InverseModel
from idim_iv_ros.types import FloatArray

# XX, XY, YY, XZ, YZ, ZZ
_ROWS, _COLUMNS = np.array([0, 0, 1, 0, 1, 2]), np.array([0, 1, 1, 2, 2, 2])
_RANGE = (float(settings.LEAST_RELATIVE_ERROR), float(settings.MOST_RELATIVE_ERROR))
# Logarithms of relative errors: first wherever they may be, and then about the likeliest.
_ALL_OVER = np.log(np.geomspace(5e-4, 1.0, 12))
_AROUND = np.linspace(-1.4, 1.4, 9)


@dataclass(frozen=True)
class _RandomEffects:
    """Whitened columns of causes (e, m), target (e,), and the covariance of a unit of each error.

    `covariances`: (e, e) of links and of drives. `difference`: of one robot between recordings,
    where errors of the nominal model cancel; nothing is then known beforehand of what is left.
    """

    causes: FloatArray
    target: FloatArray
    covariances: tuple[FloatArray, ...]
    difference: bool = False

    def solved(self, errors: FloatArray) -> "_Solved":
        """Numbers of the causes by generalised least squares, with these relative errors."""
        whole = np.eye(len(self.target))
        for error, covariance in zip(errors, self.covariances, strict=True):
            whole += error**2 * covariance
        root = np.linalg.cholesky(whole)
        both = scipy.linalg.solve_triangular(
            root, np.column_stack([self.causes, self.target]), lower=True, check_finite=False
        )
        causes, target = both[:, :-1], both[:, -1]
        norms = np.linalg.norm(causes, axis=0)
        scale = 1.0 / np.where(norms > 0.0, norms, 1.0)
        left, singular, right = np.linalg.svd(causes * scale, full_matrices=False)
        seen = singular > settings.LEAST_OWN_ENERGY
        coordinates = left[:, seen].T @ target
        inverse = scale[:, None] * right[seen].T / singular[seen]
        logarithm = (
            -float(np.sum(np.log(np.diag(root))))
            - 0.5 * float(target @ target - coordinates @ coordinates)
            - float(np.sum(np.log(singular[seen])))
            - float(np.sum(np.log(norms[norms > 0.0])))
        )
        unusual = np.log(errors / settings.USUAL_RELATIVE_ERROR) / settings.USUAL_ERROR_SPREAD
        known = 0.0 if self.difference else -0.5 * float(unusual @ unusual)
        return _Solved(
            logarithm + known,
            inverse @ coordinates,
            np.asarray(inverse @ inverse.T),
        )


@dataclass(frozen=True)
class _Solved:
    """Estimates (m,) and covariance (m, m) with some relative errors, and ln of their density.

    The density is the restricted likelihood, the causes' numbers integrated out, times what is
    known of nominal models: a payload on a planar arm leaves two directions to learn the links'
    error from.
    """

    density: float
    values: FloatArray
    covariance: FloatArray


@dataclass(frozen=True)
class Beside:
    """Estimates of changes beside errors of all other given parameters, and their covariance."""

    found: tuple[Estimated, ...]
    covariance: FloatArray


def estimated_beside_other_errors(changes: ChangeRegression, named: Sequence[Change]) -> Beside:
    """Estimate changes beside relative errors of all other given parameters.

    Where the causes leave fewer than three directions, there is nothing to learn ρ from and the
    estimates are those of `ChangeRegression.explain`.
    """
    explained = changes.explain(named)
    refit = changes.refit()
    if refit.rank - explained.rank < settings.LEAST_FREE_DIRECTIONS:
        deviations = np.array([each.std or 0.0 for each in explained.found])
        return Beside(explained.found, np.diag(deviations**2))
    effects = _random_effects(changes, named)
    values, covariance = _over_errors(effects)
    deviations = np.sqrt(np.diag(covariance))
    found = tuple(
        Estimated(each.change, float(value), float(std) if each.determined else None)
        for each, value, std in zip(explained.found, values, deviations, strict=True)
    )
    return Beside(found, covariance)


def _over_errors(effects: _RandomEffects) -> tuple[FloatArray, FloatArray]:
    """Estimates (m,) and covariance (m, m) over what the relative errors may be.

    They are known from so few directions that the likeliest alone are too sure of themselves.
    """
    coarse = _solved_at(effects, _ALL_OVER, _ALL_OVER[1::2])
    best = max(coarse, key=lambda each: coarse[each].density)
    links, drives = (np.log(each) for each in best)
    solved = list(_solved_at(effects, links + _AROUND, drives + _AROUND[::2]).values())
    densities = np.array([each.density for each in solved])
    weights = np.exp(densities - densities.max())
    weights /= weights.sum()
    values = np.array([each.values for each in solved])
    mean = weights @ values
    apart = (values - mean) * np.sqrt(weights)[:, None]
    within = np.einsum("k,kij->ij", weights, np.array([each.covariance for each in solved]))
    return mean, within + apart.T @ apart


def _solved_at(
    effects: _RandomEffects, links: FloatArray, drives: FloatArray
) -> dict[tuple[float, float], _Solved]:
    """Solutions by relative errors whose logarithms are given."""
    pairs = [tuple(np.clip(np.exp([one, two]), *_RANGE)) for one in links for two in drives]
    return {(float(one), float(two)): effects.solved(np.array([one, two])) for one, two in pairs}


def _random_effects(changes: ChangeRegression, named: Sequence[Change]) -> _RandomEffects:
    model = changes.space.model
    directions = np.column_stack([change.direction for change in named])
    base = changes.factor[:, : len(changes.space.given)] @ model.base.grouping
    parts = [base @ errors for errors in (errors_of_links(model), errors_of_drives(model))]
    return _RandomEffects(
        changes.factor @ directions,
        changes.right,
        tuple(part @ part.T for part in parts),
        changes.space.difference,
    )


def errors_of_links(model: InverseModel) -> FloatArray:
    """Changes (n_standard, k) of the given parameters that are errors of size one of the links.

    Of each link its mass, which moves its first moments and inertia too; its centre of mass along
    each axis, by the usual radius of gyration of the robot's links; and its six central moments
    and products of inertia, by their size.
    """
    given = model.robot.given
    links = [pin.Inertia.FromDynamicParameters(each) for each in given.inertial]
    length = _usual_radius(given.inertial)
    columns: list[tuple[int, FloatArray]] = []
    for joint, (link, values) in enumerate(zip(links, given.inertial, strict=True)):
        columns.append((joint, values))
        columns += [(joint, _shifted(link, length * axis)) for axis in np.eye(3)]
        moment = 0.5 * float(np.trace(link.inertia))
        for place, share in zip(range(4, 10), (1.0, 0.5, 1.0, 0.5, 0.5, 1.0), strict=True):
            columns.append((joint, share * moment * np.eye(10)[place]))
    layout = model.regressor.layout
    made = []
    for joint, own in columns:
        inertial = np.zeros_like(given.inertial)
        inertial[joint] = own
        made.append(layout.vector(replace(_nothing(given), inertial=inertial)))
    return np.column_stack(made)


def errors_of_drives(model: InverseModel) -> FloatArray:
    """The same of the drives: inertia, friction and offsets, (n_standard, k).

    By their own value, at least by the median of their kind; a joint's offset by its dry friction,
    and friction of a coupling by what is usual of the joints.
    """
    given = model.robot.given
    coulomb, viscous = _at_least_median(given.coulomb), _at_least_median(given.viscous)
    coupled = np.ones_like(given.coupling_viscous)
    sizes = replace(
        _nothing(given),
        drive_inertia=_at_least_median(given.drive_inertia),
        viscous=viscous,
        coulomb=coulomb,
        offset=coulomb,
        coupling_viscous=float(np.median(viscous)) * coupled,
        coupling_coulomb=float(np.median(coulomb)) * coupled,
    )
    return np.diag(model.regressor.layout.vector(sizes))


def _nothing(given: DynamicParameters) -> DynamicParameters:
    plain = given.of_links
    return replace(plain, inertial=np.zeros_like(plain.inertial))


def _usual_radius(inertial: FloatArray) -> float:
    """Median radius of gyration (m) of links (n, 10) about their joints."""
    mass, moment = inertial[:, 0], 0.5 * inertial[:, [4, 6, 9]].sum(axis=1)
    present = (mass > 0.0) & (moment > 0.0)
    return float(np.median(np.sqrt(moment[present] / mass[present]))) if present.any() else 0.0


def _shifted(link: pin.Inertia, shift: FloatArray) -> FloatArray:
    """Change (10,) of a link's parameters about its joint per small shift (3,) of its centre."""
    centre, mass = np.asarray(link.lever), float(link.mass)
    across = np.outer(centre, shift)
    inertia = mass * (2.0 * float(centre @ shift) * np.eye(3) - across - across.T)
    return np.concatenate([[0.0], mass * shift, inertia[_ROWS, _COLUMNS]])


def _at_least_median(values: FloatArray) -> FloatArray:
    sizes = np.abs(values)
    present = sizes[sizes > 0.0]
    return np.maximum(sizes, np.median(present)) if len(present) else sizes
