"""Numbers that mean something to an engineer, from the coefficients of a term.

Deviations hold what the shape leaves open. With it fixed, an excess of friction is known to a
percent; a Stribeck speed that is a little higher with less excess fits as well. The shape is moved
a little in every direction that the search may take, the change of the torque is fitted beside
everything else, and the covariance of all is carried over to the numbers that an engineer reads.
The search ends on a grid: how far the fit would still move a number counts as its error, too.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import scipy

from idim_iv_ros.diagnosis.comparison.model_with_terms import Term
from idim_iv_ros.diagnosis.likelihood import Fit, Regression
from idim_iv_ros.diagnosis.refit.baseline import Baseline, rows_of, with_parameters
from idim_iv_ros.effects.cause import EffectParameter
from idim_iv_ros.effects.effect import JointRange, Shape
from idim_iv_ros.types import FloatArray

_SHAPE_STEP = 0.01  # of the number of a shape
_USUAL_SHAPE = 1.0  # relative deviation of the numbers of a shape, before anything is recorded
_COEFFICIENT_STEP = 1e-4  # of the coefficient


def parameters_of(
    data: Baseline, regression: Regression, fit: Fit, term: Term, block: slice
) -> dict[str, EffectParameter]:
    """Parameters of an effect, with the coefficients that it has beside nominal errors.

    `regression`, `fit`: of the refit with all effects; `block`: the effect's columns there.
    """
    effect, shape, coefficients = term.effect, term.shape, term.coefficients
    inner = fit.coefficient_covariance[block, block]
    fixed = np.sqrt(np.maximum(np.diag(inner), 0.0))
    # Of what the refit has in its base parameters the search knows how precise it is.
    fixed = np.where(fixed > 0.0, fixed, term.deviations)
    numbers = effect.parameters(shape, coefficients, fixed)
    covered = data.covered[term.place.joint]
    near = _near(term, shape, covered) if effect.free_shape else []
    if not near:
        return numbers
    covariance, further = _with_free_shape(data, regression, fit, term, block, near)
    slopes = _slopes(term, fixed, [shape, *near])
    variances = np.einsum("pi,ij,pj->p", slopes, covariance, slopes) + (slopes @ further) ** 2
    return {
        name: replace(number, std=float(np.sqrt(variance)) if variance > 0.0 else None)
        for (name, number), variance in zip(numbers.items(), variances, strict=True)
    }


def _with_free_shape(
    data: Baseline, regression: Regression, fit: Fit, term: Term, block: slice, near: list[Shape]
) -> tuple[FloatArray, FloatArray]:
    """Covariance of an effect's k coefficients beside m moves of its shape, (k + m, k + m).

    And by how much the fit would still move each of them, (k + m,).
    """
    effect, shape = term.effect, term.shape
    # Of the torque that the fit leaves to the model, as `knee` has it.
    of_the_fit = with_parameters(data, fit.values) if effect.beyond_knee else data
    here, *moved = rows_of(of_the_fit, effect, term.place, [shape, *near])
    changes = {
        joint: np.column_stack([(rows[joint] - here[joint]) @ term.coefficients for rows in moved])
        for joint in here
    }
    wider = regression.with_columns(changes).fit(fit.noise_models, steps=0)
    places = np.r_[block, len(fit.coefficients) : len(wider.coefficients)]
    further = wider.coefficients[places]
    further[: term.width] -= term.coefficients
    covariance = wider.coefficient_covariance[np.ix_(places, places)]
    # Directions that the recording leaves open end where sizes and shapes usually do.
    usual = scipy.linalg.block_diag(
        term.prior_root @ term.prior_root.T, np.eye(len(near)) * (_USUAL_SHAPE / _SHAPE_STEP) ** 2
    )
    open_share = covariance @ np.linalg.pinv(covariance + usual)
    return covariance - open_share @ covariance, further - open_share @ further


def _near(term: Term, shape: Shape, covered: JointRange) -> list[Shape]:
    """One neighbour for each number, or numbers that move together, of the shape."""
    kept: dict[tuple[int, ...], Shape] = {}
    for near in term.effect.neighbours(shape, _SHAPE_STEP, covered):
        pairs = zip(near.numbers, shape.numbers, strict=True)
        moved = tuple(k for k, (a, b) in enumerate(pairs) if a != b)
        if moved:
            kept.setdefault(moved, near)
    return list(kept.values())


def _slopes(term: Term, deviations: FloatArray, shapes: Sequence[Shape]) -> FloatArray:
    """Change of each parameter (p, k + m) with each coefficient and with each move of the shape.

    `shapes`: that of the term, and it moved.
    """
    coefficients = term.coefficients

    def values(shape: Shape, coefficients: FloatArray) -> FloatArray:
        numbers = term.effect.parameters(shape, coefficients, np.zeros(len(coefficients)))
        return np.array([number.value for number in numbers.values()])

    shape, *near = shapes
    here = values(shape, coefficients)
    sizes = np.maximum(np.maximum(np.abs(coefficients), deviations), 1e-12)
    slopes = scipy.optimize.approx_fprime(
        coefficients, lambda changed: values(shape, changed), _COEFFICIENT_STEP * sizes
    )
    moves = [values(other, coefficients) - here for other in near]
    return np.column_stack([slopes.reshape(len(here), -1), *moves])
