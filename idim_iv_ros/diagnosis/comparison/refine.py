"""Shapes between those that are searched, and the numbers of all terms together."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.special import softmax

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.comparison.compare import Comparison
from idim_iv_ros.diagnosis.comparison.model_with_terms import Term, unit_basis
from idim_iv_ros.effects.effect import Shape
from idim_iv_ros.estimation.likelihood import width_of

_STEPS = (0.3, 0.15, 0.07)  # relative, of the numbers of a shape
_MOVES = 4  # at most, of one step
_BEYOND_GRID = 0.3
_LEAST_GAIN = 0.1  # of the logarithm of the evidence


def refined(comparison: Comparison, terms: Sequence[Term]) -> tuple[Term, ...]:
    """Terms with the shapes about theirs that are likeliest, all coefficients fitted together."""
    kept = list(terms)
    for number, term in enumerate(kept):
        if term.shape.numbers:
            kept[number] = _refined(comparison, kept, number)
            kept[number] = _likeliest_name(comparison, kept, number)
    others = [[*kept[:number], *kept[number + 1 :]] for number in range(len(kept))]
    return together(comparison, list(map(comparison.weighed, kept, others)))


def stopped_by_physics(comparison: Comparison, terms: Sequence[Term], number: int) -> str:
    """Why no arm has the likeliest shape near that of a term; empty where one may have it.

    The search stops at the edge of what arms have. Where the likeliest shape lies beyond it, the
    torque is that of something else.
    """
    term = _refined(comparison, terms, number, possible=False)
    model = comparison.with_terms([*terms[:number], term, *terms[number + 1 :]])
    values = model.coefficients[model.blocks[number]]
    return comparison.catalogue.why_impossible(term.candidate, term.shape, values, values)


def _refined(
    comparison: Comparison, terms: Sequence[Term], number: int, *, possible: bool = True
) -> Term:
    """A term with the likeliest shape; `possible`: of those that physics allows."""
    term = terms[number]
    effect, covered = term.effect, comparison.catalogue.data.covered[term.place.joint]
    highest = comparison.with_terms(terms).level
    for step in _STEPS:
        for _ in range(_MOVES):
            near = effect.neighbours(term.shape, step, covered)
            best = _best_of(comparison, terms, number, near, possible=possible)
            if best is None or best[0] < highest + _LEAST_GAIN:
                break
            highest, term = best
    while True:
        longer = effect.longer(term.shape, covered) if possible else []
        best = _best_of(comparison, terms, number, longer)
        if best is None or best[0] < highest + settings.LEAST_EVIDENCE_OF_TERM:
            return term
        highest, term = best


def _likeliest_name(comparison: Comparison, terms: Sequence[Term], number: int) -> Term:
    """The term, or another effect of its place with the same shape, whichever is likelier.

    Ripple of the torque and of the effort's gain have the same waves. Before these are refined, the
    nearest waves of the grid may favour either.
    """
    term, compared = terms[number], comparison.options
    options = [(comparison.with_terms(terms).level + term.log_prior, term)]
    for which, candidate in enumerate(compared.candidates):
        alike = type(candidate.shapes[0]) is type(term.shape) and candidate.key != term.key
        if not alike or (candidate.place, candidate.scope) != (term.place, term.candidate.scope):
            continue
        log_prior = float(compared.log_prior[compared.candidate == which][0])
        other = replace(term, candidate=candidate, log_prior=log_prior)
        others = [*terms[:number], other, *terms[number + 1 :]]
        best = _best_of(comparison, others, number, [term.shape], anew=True)
        if best is not None:
            others[number] = best[1]
            other = _refined(comparison, others, number)
            others[number] = other
            level = comparison.with_terms(others).level
            options.append((level + other.log_prior, other))
    levels = np.array([level for level, _ in options])
    likeliest = options[int(np.argmax(levels))][1]
    if likeliest is term:
        return term
    weights = zip((other.key for _, other in options), softmax(levels).tolist(), strict=True)
    return replace(likeliest, rivals=tuple(sorted(weights, key=lambda pair: -pair[1])))


def _best_of(
    comparison: Comparison,
    terms: Sequence[Term],
    number: int,
    shapes: Sequence[Shape],
    *,
    anew: bool = False,
    possible: bool = True,
) -> tuple[float, Term] | None:
    """The likeliest of some shapes in the place of a term, and the level of the model with it.

    `anew`: whether the term still has the units of another effect; `possible`: whether an arm must
    be able to have the sizes; signs must be those of the effect in any case.
    """
    term, catalogue = terms[number], comparison.catalogue
    shapes = [shape for shape in shapes if _within_grid(term, shape)]
    best: tuple[float, Term] | None = None
    for shape, columns in zip(shapes, catalogue.columns_of(term.candidate, shapes), strict=True):
        if not all(np.isfinite(table).all() for table in columns.values()):
            continue
        width, basis = width_of(columns), term.basis
        if anew or width != term.width:
            sizes = comparison.options.ledger.sizes
            of_joints = [t.T @ t / (len(t) * sizes[joint] ** 2) for joint, t in columns.items()]
            inner = np.sum(of_joints, axis=0)
            basis = unit_basis(inner, np.trace(inner))
        other = replace(
            term,
            shape=shape,
            columns=dict(columns),
            basis=basis,
            coefficients=np.zeros(width),
        )
        model = comparison.with_terms([*terms[:number], other, *terms[number + 1 :]])
        values = model.coefficients[model.blocks[number]]
        if not term.effect.admissible(shape, values):
            continue
        if possible and catalogue.why_impossible(term.candidate, shape, values, values):
            continue
        if best is None or model.level > best[0]:
            best = model.level, other
    return best


def _within_grid(term: Term, shape: Shape) -> bool:
    """Whether the numbers of a shape are those of the grid, or little beyond its ends."""
    grid = term.candidate.ranges.get((type(shape), len(shape.numbers)))
    if grid is None:
        return True
    low, high = grid
    room = _BEYOND_GRID * np.maximum(np.abs(low), np.abs(high))
    numbers = np.array(shape.numbers)
    ratio = np.where((low > 0.0) & (numbers > 0.0), low / np.maximum(numbers, 1e-300), 0.0)
    inside = (numbers <= high + room) & (numbers >= low - room)
    return bool(np.all(inside & (ratio <= 1.0 + _BEYOND_GRID)))


def together(comparison: Comparison, terms: Sequence[Term]) -> tuple[Term, ...]:
    """Terms with the coefficients, deviations and shares that they have beside one another."""
    model = comparison.with_terms(terms)
    made = []
    for term, part in zip(terms, model.blocks, strict=True):
        values = model.coefficients[part]
        spread = np.sqrt(np.diag(model.covariance)[part] * term.dispersion)
        whole = comparison.options.ledger.shares(term.columns, values)
        made.append(replace(term, coefficients=values, deviations=spread, whole=whole))
    return tuple(made)
