"""Numbers of an effect with standard deviations that hold what its shape leaves open.

With its shape held, an excess of friction is known to a percent; a Stribeck speed that is a little
higher with less excess fits as well. The shape is moved a little in every direction that the search
may take, the change of the torque is fitted beside everything else, and the covariance of all is
carried over to the numbers that an engineer reads. The search ends on a grid: how far the fit
would still move a number counts as its error, too.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.parametric.significance import any_differs
from idim_iv_ros.diagnosis.refit.baseline import Baseline, with_parameters
from idim_iv_ros.diagnosis.result import EffectParameter
from idim_iv_ros.diagnosis.structural.candidate import Candidate, operating_range, rows_of
from idim_iv_ros.diagnosis.structural.likelihood import Columns, Fit, Regression, width_of
from idim_iv_ros.diagnosis.structural.scan import Scan
from idim_iv_ros.effects.effect import Effect, OperatingRange, Place, Shape
from idim_iv_ros.types import FloatArray


def parameters_of(
    data: Baseline, regression: Regression, fit: Fit, candidate: Candidate, start: int
) -> dict[str, EffectParameter]:
    """Parameters of one effect among all that were added.

    Parameters
    ----------
    regression, fit
        With all effects.
    candidate
        The effect.
    start
        Place of its first column among the added ones.
    """
    effect, shape = candidate.effect, candidate.shape
    free = _with_free_shape(data, regression, fit, candidate, start)
    coefficients = fit.coefficients[start : start + candidate.width]
    found = effect.parameters(shape, coefficients, free.held)
    if not free.near:
        return found
    slopes = _slopes(effect, shape, coefficients, free.held, free.near)
    variances = np.einsum("pi,ij,pj->p", slopes, free.covariance, slopes)
    variances += (slopes @ free.further) ** 2
    return {
        name: EffectParameter(
            each.value, float(np.sqrt(max(variance, 0.0))) if slope.any() else None, each.unit
        )
        for (name, each), slope, variance in zip(found.items(), slopes, variances, strict=True)
    }


def differs_from_nothing(
    data: Baseline, regression: Regression, fit: Fit, candidate: Candidate, start: int
) -> bool:
    """Whether an effect is known to differ from nothing at 95 %, by likelihood ratios.

    All its numbers together, and one coefficient at least whatever the shape: collinear columns
    may fit well together while each of them may be anything. Not by the deviations of its numbers:
    a power near one, or a bend that is wide, leaves each number unknown where the torque is sure,
    and the slope over such a shape holds only nearby.

    Parameters
    ----------
    regression, fit, candidate, start
        As `parameters_of`.
    """
    others, before = Regression(regression.joints, regression.parameters), 0
    for block, width in zip(regression.added, regression.widths, strict=True):
        others = others if before == start else others.with_columns(block)
        before += width
    noise = fit.noise_models
    scan = Scan(others, noise, others.fit(noise, steps=0).residuals)
    whole, _ = scan.score(candidate.columns)
    if chi2.sf(whole, candidate.numbers) > settings.SIGNIFICANCE_LEVEL:
        return False
    if candidate.width == 1:
        return True
    shapes = _of_equal_width(data, candidate)
    for column in range(candidate.width):
        fewer = [
            {j: np.delete(rows, column, axis=1) for j, rows in each.items()} for each in shapes
        ]
        most = max(score for score, _ in scan.scores(fewer))
        if whole - most >= settings.NORMAL_95**2:
            return True
    return False


def _of_equal_width(data: Baseline, candidate: Candidate) -> list[Columns]:
    """Columns of a candidate, and of the shapes of its grid that have as many."""
    effect, place = candidate.effect, candidate.place
    grid = effect.grid(place, operating_range(data)) if effect.free_shape else []
    same = [shape for shape in grid if type(shape) is type(candidate.shape)]
    made = rows_of(data, effect, place, same) if same else []
    equal = [rows for rows in made if width_of(rows) == candidate.width]
    return [candidate.columns, *equal]


def numbers_differ_from_nothing(
    data: Baseline, regression: Regression, fit: Fit, candidate: Candidate, start: int
) -> bool:
    """Whether one number at least that gives the size of an effect differs from zero at 95 %.

    See `significance.any_differs`, with the shape free; of its coefficients, which scale its
    torque. Where a coefficient only scales a shape, of the numbers that an engineer reads: both
    together are one number.
    """
    free = _with_free_shape(data, regression, fit, candidate, start)
    width = candidate.width
    values = fit.coefficients[start : start + width]
    covariance = free.covariance[:width, :width] + np.diag(free.further[:width] ** 2)
    if candidate.effect.size_in == "scale":
        effect, shape = candidate.effect, candidate.shape
        slopes = _slopes(effect, shape, values, free.held, free.near)
        read = [each.value for each in effect.parameters(shape, values, free.held).values()]
        sizes = np.any(slopes[:, :width] != 0.0, axis=1)
        values, slopes = np.array(read)[sizes], slopes[sizes]
        covariance = slopes @ free.covariance @ slopes.T + np.diag((slopes @ free.further) ** 2)
    return any_differs(values, covariance)


@dataclass(frozen=True)
class _FreeShape:
    """Coefficients of an effect (k,) beside moves of its shape (m,).

    Attributes
    ----------
    near : list of Shape
        One for each move.
    held : (k,)
        Deviations with the shape held.
    covariance : (k + m, k + m)
    further : (k + m,)
        How far the fit would still move each.
    """

    near: list[Shape]
    held: FloatArray
    covariance: FloatArray
    further: FloatArray


def _with_free_shape(
    data: Baseline, regression: Regression, fit: Fit, candidate: Candidate, start: int
) -> _FreeShape:
    effect, shape = candidate.effect, candidate.shape
    own = np.arange(start, start + candidate.width)
    coefficients = fit.coefficients[own]
    inner = fit.coefficient_covariance[np.ix_(own, own)]
    held = np.sqrt(np.maximum(np.diag(inner), 0.0))
    near = _near(effect, shape, candidate.place, operating_range(data)) if effect.free_shape else []
    if not near:
        return _FreeShape([], held, inner, np.zeros(len(own)))
    # Of the torque that the fit leaves to the model, as `knee` has it.
    own_torque = with_parameters(data, fit.values) if effect.beyond_knee else data
    here, *moved = rows_of(own_torque, effect, candidate.place, [shape, *near])
    changes = {
        joint: np.column_stack([(rows[joint] - here[joint]) @ coefficients for rows in moved])
        for joint in here
    }
    wider = regression.with_columns(changes).fit(fit.noise_models, steps=0)
    places = np.concatenate([own, len(wider.coefficients) - len(near) + np.arange(len(near))])
    further = wider.coefficients[places]
    further[: len(own)] -= coefficients
    covariance = wider.coefficient_covariance[np.ix_(places, places)]
    return _FreeShape(near, held, covariance, further)


def _near(effect: Effect, shape: Shape, place: Place, covered: OperatingRange) -> list[Shape]:
    """One neighbour for each number, or numbers that move together, of the shape."""
    kept: dict[tuple[int, ...], Shape] = {}
    for near in effect.neighbours(shape, settings.SHAPE_STEP, place, covered):
        pairs = zip(near.numbers, shape.numbers, strict=True)
        moved = tuple(k for k, (a, b) in enumerate(pairs) if a != b)
        if moved:
            kept.setdefault(moved, near)
    return list(kept.values())


def _slopes(
    effect: Effect,
    shape: Shape,
    coefficients: FloatArray,
    held: FloatArray,
    near: Sequence[Shape],
) -> FloatArray:
    """Change of each parameter (p, k + m) with each coefficient and with each move of the shape."""

    def values(shape: Shape, coefficients: FloatArray) -> FloatArray:
        found = effect.parameters(shape, coefficients, np.zeros(len(coefficients)))
        return np.array([each.value for each in found.values()])

    here = values(shape, coefficients)
    slopes = []
    for k, size in enumerate(np.maximum(np.abs(coefficients), held)):
        step = settings.COEFFICIENT_STEP * max(float(size), 1e-12)
        changed = coefficients.copy()
        changed[k] += step
        slopes.append((values(shape, changed) - here) / step)
    slopes += [values(other, coefficients) - here for other in near]
    return np.column_stack(slopes)
