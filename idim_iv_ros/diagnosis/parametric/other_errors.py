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

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
import pinocchio as pin
import scipy

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.parametric.change_regression import ChangeRegression
from idim_iv_ros.diagnosis.parametric.significance import together
from idim_iv_ros.effects.parametric_effect import Change, Estimated
from idim_iv_ros.model import DynamicParameters, InverseModel
from idim_iv_ros.types import FloatArray

_ERRORS_OF_LINK = 10  # mass, three of the centre, six moments
# XX, XY, YY, XZ, YZ, ZZ
_ROWS, _COLUMNS = np.array([0, 0, 1, 0, 1, 2]), np.array([0, 1, 1, 2, 2, 2])
_RANGE = (float(settings.LEAST_RELATIVE_ERROR), float(settings.MOST_RELATIVE_ERROR))
# Logarithms of relative errors: first wherever they may be, one after the other, and then about the
# likeliest, all together; of drives fewer, for they hardly move a mass.
_ALL_OVER = np.log(np.geomspace(5e-4, 1.0, 8))
_NEARER = np.array([-0.7, -0.35, 0.35, 0.7])
_AROUND = (np.linspace(-1.4, 1.4, 5), np.linspace(-1.4, 1.4, 5), np.linspace(-1.0, 1.0, 3))
_SWEEPS = 2
_LEAST_WEIGHT = 1e-4  # of a test: together they are less than a hundredth


@dataclass(frozen=True)
class _RandomEffects:
    """Whitened columns of causes (e, m), target (e,), and the covariance of a unit of each error.

    `covariances`: (e, e) of the links' masses, of their shapes and of drives, or of all together.
    `difference`: of one
    robot between recordings, where errors of the nominal model cancel; nothing is then known
    beforehand of what is left.
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
    """Estimates of m changes beside errors of all other given parameters.

    Attributes
    ----------
    found : tuple of Estimated
        In the order of the changes.
    weights : (k,)
        Of the relative errors that were tried, together one.
    values : (k, m)
        With each of them.
    covariances : (k, m, m)
    """

    found: tuple[Estimated, ...]
    weights: FloatArray
    values: FloatArray
    covariances: FloatArray

    def p_value(self, part: slice) -> float:
        """p-value of Wald's test that some of the changes are all zero.

        The mean over what the relative errors may be: they are known from few directions, and a
        covariance of all of them together has not the tails of their mixture.
        """
        return float(
            sum(
                weight * together(values[part], covariance[part, part])
                for weight, values, covariance in zip(
                    self.weights, self.values, self.covariances, strict=True
                )
                if weight > _LEAST_WEIGHT
            )
        )


def estimated_beside_other_errors(
    changes: ChangeRegression,
    named: Sequence[Change],
    known: Collection[int | None] = (),
    *,
    one_size: bool = False,
) -> Beside:
    """Estimate changes beside relative errors of all other given parameters.

    Parameters
    ----------
    changes
    named
    known
        Joints whose links have no errors of their own beside the named changes: these hold them.
    one_size
        Links and drives have the same relative error; each its own otherwise.

    Where the causes leave fewer than three directions, there is nothing to learn ρ from and the
    estimates are those of `ChangeRegression.explain`.
    """
    explained = changes.explain(named)
    refit = changes.refit()
    if refit.rank - explained.rank < settings.LEAST_FREE_DIRECTIONS:
        values = np.array([each.value for each in explained.found])
        deviations = np.array([each.std or 0.0 for each in explained.found])
        return Beside(explained.found, np.ones(1), values[None], np.diag(deviations**2)[None])
    weights, values, covariances = _over_errors(_random_effects(changes, named, known, one_size))
    mean = weights @ values
    apart = weights @ (values - mean) ** 2
    deviations = np.sqrt(weights @ np.einsum("kii->ki", covariances) + apart)
    found = tuple(
        Estimated(each.change, float(value), float(std) if each.determined else None)
        for each, value, std in zip(explained.found, mean, deviations, strict=True)
    )
    return Beside(found, weights, values, covariances)


def _over_errors(effects: _RandomEffects) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Weights (k,), estimates (k, m) and covariances (k, m, m) over what relative errors may be.

    They are known from so few directions that the likeliest alone are too sure of themselves.
    """
    start, around = _likeliest(effects), _AROUND[: len(effects.covariances)]
    solved = [effects.solved(_within_range(start + np.array(step))) for step in product(*around)]
    densities = np.array([each.density for each in solved])
    weights = np.exp(densities - densities.max())
    return (
        weights / weights.sum(),
        np.array([each.values for each in solved]),
        np.array([each.covariance for each in solved]),
    )


def _likeliest(effects: _RandomEffects) -> FloatArray:
    """Logarithms of the relative errors of each kind of about the highest density, in turn."""
    best = np.full(len(effects.covariances), np.log(float(settings.USUAL_RELATIVE_ERROR)))
    highest = effects.solved(_within_range(best)).density
    for sweep in range(_SWEEPS):
        for kind in range(len(best)):
            for value in _NEARER + best[kind] if sweep else _ALL_OVER:
                other = best.copy()
                other[kind] = value
                density = effects.solved(_within_range(other)).density
                if density > highest:
                    best, highest = other, density
    return best


def _within_range(logarithms: FloatArray) -> FloatArray:
    return np.asarray(np.clip(np.exp(logarithms), *_RANGE))


def _random_effects(
    changes: ChangeRegression,
    named: Sequence[Change],
    known: Collection[int | None],
    one_size: bool,
) -> _RandomEffects:
    model = changes.space.model
    directions = np.column_stack([change.direction for change in named])
    base = changes.factor[:, : len(changes.space.given)] @ model.base.grouping
    links = errors_of_links(model)
    joint, number = np.divmod(np.arange(links.shape[1]), _ERRORS_OF_LINK)
    masses, free = number == 0, np.array([each not in known for each in joint])
    kinds = links[:, masses & free], links[:, ~masses & free], errors_of_drives(model)
    parts = [base @ errors for errors in ((np.hstack(kinds),) if one_size else kinds)]
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
