"""Estimates of causes beside errors of all other given numbers, which no cause names.

A nominal model is off everywhere by a little. Beside a payload of 1.5 kg, inertials that are wrong
by ten percent move its mass by far more than the noise does. They are random effects here,

    y − X β₀ = D θ + X S u + e,   u ~ N(0, ρ² I),

S the size of each given number; ρ is estimated from what the causes leave (REML), and θ with its
deviations by generalised least squares.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.parametric.change_regression import ChangeRegression
from idim_iv_ros.effects.parametric_effect import Change, Estimated
from idim_iv_ros.model import InverseModel
from idim_iv_ros.types import FloatArray


@dataclass(frozen=True)
class _Whitened:
    """Columns of causes (e, m) and target (e,), and the singular system of the other errors."""

    causes: FloatArray
    target: FloatArray
    left: FloatArray
    singular: FloatArray

    def at(self, error: float) -> tuple[FloatArray, FloatArray, float]:
        """Causes and target with errors of relative size `error` whitened, and ln |C|."""
        power = 1.0 + (error * self.singular) ** 2
        shrink = 1.0 - 1.0 / np.sqrt(power)
        causes = self.causes - self.left @ (shrink[:, None] * (self.left.T @ self.causes))
        target = self.target - self.left @ (shrink * (self.left.T @ self.target))
        return causes, target, float(np.sum(np.log(power)))


def estimated_beside_other_errors(
    changes: ChangeRegression, named: Sequence[Change]
) -> tuple[Estimated, ...]:
    """Estimate changes beside relative errors of all other given base parameters.

    Where the causes leave fewer than three directions, there is nothing to learn ρ from and the
    estimates are those of `ChangeRegression.explain`.
    """
    explained = changes.explain(named)
    refit = changes.refit()
    if refit.rank - explained.rank < settings.LEAST_FREE_DIRECTIONS:
        return explained.found
    base = changes.factor[:, : len(changes.space.given)]
    left, singular, _ = np.linalg.svd(
        base * sizes(changes.space.model, changes.space.given), full_matrices=False
    )
    directions = np.column_stack([change.direction for change in named])
    whitened = _Whitened(changes.factor @ directions, changes.right, left, singular)
    found = scipy.optimize.minimize_scalar(
        lambda logarithm: -_restricted_likelihood(whitened, float(np.exp(logarithm))),
        bounds=tuple(np.log([settings.LEAST_RELATIVE_ERROR, settings.MOST_RELATIVE_ERROR])),
        method="bounded",
    )
    causes, target, _ = whitened.at(float(np.exp(found.x)))
    norms = np.linalg.norm(causes, axis=0)
    scale = 1.0 / np.where(norms > 0.0, norms, 1.0)
    _, singular, right = np.linalg.svd(causes * scale, full_matrices=False)
    seen = singular > settings.LEAST_OWN_ENERGY
    root = right[seen].T / singular[seen]
    covariance = root @ root.T * np.outer(scale, scale)
    values = covariance @ (causes.T @ target)
    # ρ is known from so few directions only: the normal interval is as wide as Student's.
    student = float(scipy.stats.t.isf(0.025, refit.rank - explained.rank)) / settings.NORMAL_95
    deviations = student * np.sqrt(np.diag(covariance))
    return tuple(
        Estimated(each.change, float(value), float(std) if each.determined else None)
        for each, value, std in zip(explained.found, values, deviations, strict=True)
    )


def sizes(model: InverseModel, given: FloatArray) -> FloatArray:
    """Size of each given base parameter (b,): its own, and at least the median of its unit."""
    values = np.abs(given)
    units = np.array(model.base.units)
    found = values.copy()
    for unit in set(model.base.units):
        of_unit = units == unit
        present = values[of_unit & (values > 0.0)]
        if len(present):
            found[of_unit] = np.maximum(values[of_unit], np.median(present))
    return found


def _restricted_likelihood(whitened: _Whitened, error: float) -> float:
    """Logarithm, of the relative error, the causes' numbers integrated out."""
    causes, target, determinant = whitened.at(error)
    norms = np.linalg.norm(causes, axis=0)
    left, singular, _ = np.linalg.svd(
        causes / np.where(norms > 0.0, norms, 1.0), full_matrices=False
    )
    seen = singular > settings.LEAST_OWN_ENERGY
    rest = target - left[:, seen] @ (left[:, seen].T @ target)
    own = float(np.sum(np.log(singular[seen]))) + float(np.sum(np.log(norms[norms > 0.0])))
    return -0.5 * (determinant + float(rest @ rest)) - own
