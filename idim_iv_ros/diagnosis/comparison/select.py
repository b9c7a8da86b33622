"""The set of numbers and effects that explains the gap: one climb over one objective.

Grow: test every term again beside the others, then add the best option, until nothing is added or
a set recurs; the best set seen counts. Then leave each term out and grow again from the rest, and
from each single one of the rest. The nominal errors have a relative size for links and one for
drives: the one that makes the whole likelier, each size with a set of its own.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product
from operator import itemgetter

import numpy as np
import scipy

from idim_iv_ros.compilation import return_freed_memory
from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.comparison.candidate import Catalogue, Kind, Scope
from idim_iv_ros.diagnosis.comparison.compare import Comparison
from idim_iv_ros.diagnosis.comparison.ledger import RELATIVE_ERRORS, Ledger, noise_of
from idim_iv_ros.diagnosis.comparison.model_with_terms import ModelWithTerms, NominalErrors, Term
from idim_iv_ros.diagnosis.comparison.options import Options, Whitened, whitened
from idim_iv_ros.diagnosis.comparison.refine import refined
from idim_iv_ros.estimation.least_squares import stacked
from idim_iv_ros.estimation.qr import independent_basis
from idim_iv_ros.types import BoolArray, FloatArray

Terms = tuple[Term, ...]
Grown = tuple[float, Terms]  # a set with its objective
_MOST_TERMS = 8  # besides errors of signals, which every joint may have
_ROUNDS = 18  # of adding one term
_RESTARTS = 3
# Objective that a set of as many terms as there may be may lack if restarts are to make up for it:
# in 34 recordings of `benchmarks.hostile` they gained 109 of 723 once, and 18 at most else.
_WITHIN_RESTARTS = 50.0
_NOISE_VISITS = 3
_MOST_ERRORS = 5  # sizes of the nominal errors that are climbed with
_MOST_CURVES = 3
_ROWS_PER_COLUMN = 4


@dataclass(frozen=True, eq=False)
class Selection:
    """Terms that explain the gap, free curves of what they leave, and what compared them."""

    terms: Terms
    curves: Terms
    comparison: Comparison
    displaced: tuple[tuple[Term, Term], ...] = ()  # effects, and the likelier curve

    @property
    def catalogue(self) -> Catalogue:
        """What was searched: candidates of which session."""
        return self.comparison.catalogue

    @property
    def signals(self) -> tuple[Term, ...]:
        """Terms that are errors of signals."""
        return tuple(term for term in self.terms if term.candidate.kind is Kind.SIGNAL)

    @property
    def model(self) -> ModelWithTerms:
        """The nominal errors with the terms and the curves."""
        return self.comparison.with_terms((*self.terms, *self.curves))


def select(catalogue: Catalogue, ledger: Ledger) -> Selection:
    """Search for what explains the gap of a ledger."""
    options = Options(ledger, catalogue.candidates)
    noise = noise_of(ledger, _without_curves(ledger, catalogue))
    terms: Terms = ()
    errors: tuple[float, float] | None = None
    for visit in range(_NOISE_VISITS):
        white = whitened(options, noise)
        return_freed_memory()
        if errors is None:
            comparison, terms = _with_likely_errors(catalogue, white)
            errors = comparison.nominal.errors
        else:
            comparison = Comparison(catalogue, NominalErrors(white, errors))
            terms = climb(comparison, terms)
        terms = refined(comparison, terms)
        if visit < _NOISE_VISITS - 1:
            noise = noise_of(ledger, comparison.with_terms(terms).residuals)
            del white, comparison  # products of all options would be there twice
    displaced: list[tuple[Term, Term]] = []
    curves: list[Term] = []
    while (swap := _curve_in_place(comparison, terms, curves)) is not None:
        gone, in_place = swap
        terms = tuple(term for term in terms if term not in gone)
        displaced += [(term, in_place) for term in gone]
        curves.append(in_place)
    if displaced:
        terms = refined(comparison, terms)
    while len(curves) < _MOST_CURVES:
        curve = comparison.curve([*terms, *curves])
        if curve is None or curve.presence < 0.5:
            break
        curves.append(curve)
    return Selection(tuple(terms), tuple(curves), comparison, tuple(displaced))


def _curve_in_place(
    comparison: Comparison, terms: Terms, curves: Sequence[Term]
) -> tuple[Terms, Term] | None:
    """The effect, or those of one family at a joint, in whose place a free curve gains most.

    A shape that comes near what no effect describes is chosen first, having fewer numbers. A curve
    that is the effect in another form leaves it its name; one with more coefficients than the
    effects have numbers gains from what their shapes miss. None where no other curve of their
    joint is clearly likelier; else the curve, too.
    """
    best, most = None, 0.0
    usual = comparison.objective((*terms, *curves))
    effects = [term for term in terms if term.is_effect]
    families: dict[tuple[str, int, Scope], Terms] = {}
    for term in effects:
        alike = term.effect.family, term.place.joint, term.candidate.scope
        families[alike] = (*families.get(alike, ()), term)
    groups = [(term,) for term in effects] + [some for some in families.values() if len(some) > 1]
    for gone in groups:
        others = [*(term for term in terms if term not in gone), *curves]
        curve = comparison.curve(others, gone)
        where = gone[0].place.joint, gone[0].candidate.scope
        if curve is None or (curve.place.joint, curve.candidate.scope) != where:
            continue
        gain = comparison.objective([*others, curve]) - usual - settings.LEAST_SUPPORT
        if curve.width > sum(term.width + len(term.shape.numbers) for term in gone):
            explained = max(usual - comparison.objective(others), 0.0)
            gain -= settings.MISFIT_OF_OTHERS**2 * explained
        if gain > most:
            best, most = (gone, curve), gain
    return best


def _without_curves(ledger: Ledger, catalogue: Catalogue) -> list[FloatArray]:
    """(r_j,) what the refit leaves less all free curves of the joint, where rows are many enough.

    Noise that holds an effect takes slow ones for its own.
    """
    left = refit_residuals(ledger, ledger.gap)
    for joint, rows in enumerate(ledger.joints):
        columns = [
            candidate.lines[joint][-candidate.width :]
            for candidate in catalogue.candidates
            if candidate.kind is Kind.CURVE and not candidate.scope and joint in candidate.lines
        ]
        if not columns or rows.left_out:
            continue
        table = np.concatenate([rows.matrix.T, *columns]).T.astype(float)
        if len(table) < _ROWS_PER_COLUMN * table.shape[1]:
            continue
        left[joint] = independent_basis(table).remove(left[joint])
    return left


def refit_residuals(
    ledger: Ledger,
    gap: Sequence[FloatArray],
    counted: Sequence[BoolArray] | None = None,
) -> list[FloatArray]:
    """(r_j,) what new numbers, all of them free, leave of a gap (r_j,) by least squares.

    `counted`: rows (r_j,) that are fitted; None: all.
    """
    fitted = [replace(rows, torque=left) for rows, left in zip(ledger.joints, gap, strict=True)]
    if counted is not None:
        fitted = [
            replace(rows, matrix=rows.matrix[some], torque=rows.torque[some])
            for rows, some in zip(fitted, counted, strict=True)
        ]
    factor = stacked(fitted, ledger.parameters, 1.0 / ledger.sizes)
    change = independent_basis(factor[:, :-1]).solve(factor[:, -1], ledger.parameters)
    return [
        left - rows.matrix @ change[rows.columns]
        for rows, left in zip(ledger.joints, gap, strict=True)
    ]


def _with_likely_errors(catalogue: Catalogue, white: Whitened) -> tuple[Comparison, Terms]:
    """Climb from small and from likely nominal errors, and again where others are likelier."""
    if not white.options.ledger.nominal:
        only = Comparison(catalogue, NominalErrors(white, (1.0, 1.0)))
        return only, climb(only, ())
    starts = [likeliest_errors(white, ())]
    starts += [(size, size) for size in RELATIVE_ERRORS[:2]]
    best: tuple[float, Comparison, Terms] | None = None
    tried: set[tuple[float, float]] = set()
    while starts:
        errors = starts.pop(0)
        if errors in tried:
            continue
        tried.add(errors)
        this = Comparison(catalogue, NominalErrors(white, errors))
        # From nothing, and from what is best so far, which other errors may have led to.
        starts_of_terms: list[Terms] = [()] if best is None else [(), best[2]]
        grown = [_grown(this, start) for start in starts_of_terms]
        reached, terms = max(grown, key=itemgetter(0))
        value = reached + _usual(errors, terms)
        if not _is_full(terms) or best is None or value > best[0] - _WITHIN_RESTARTS:
            # Fewer terms may be taken for misfit of many: that says nothing of the errors.
            restarted, terms = _restarted(this, (reached, terms))
            value = max(reached, restarted) + _usual(errors, terms)
        if len(tried) < _MOST_ERRORS:
            starts.append(likeliest_errors(white, terms))
        if best is None or value > best[0]:
            best = value, this, terms
        del this  # before the next one is made
    assert best is not None
    return best[1], best[2]


def _usual(errors: tuple[float, float], terms: Terms) -> float:
    """What is usual of nominal errors; as many terms as there may be are as rare as large errors.

    Where all numbers are wrong by 10 % a few of them explain most of the gap, with wrong sizes.
    """
    usual = log_prior_of_errors(errors)
    if _is_full(terms):
        usual = min(usual, log_prior_of_errors((RELATIVE_ERRORS[-1], RELATIVE_ERRORS[-1])))
    return usual / settings.TEMPER


def log_prior_of_errors(errors: tuple[float, float]) -> float:
    """Logarithm of what is usual of nominal models."""
    logs = np.log(np.array(errors) / RELATIVE_ERRORS[0])
    apart = float(logs[0] - logs[1])
    apart /= settings.LINKS_WORSE if apart > 0.0 else settings.DRIVES_WORSE
    return -settings.ERROR_COST * float(logs.max()) - 0.5 * apart**2


def likeliest_errors(white: Whitened, terms: Sequence[Term]) -> tuple[float, float]:
    """Relative errors of links and drives under which rows and terms are likeliest."""
    ledger, tables = white.options.ledger, []
    columns = [(term.width, white.columns(term.columns)) for term in terms]
    for joint, rows in enumerate(ledger.joints):
        model = np.zeros((len(rows), ledger.parameters))
        model[:, rows.columns] = white.model[joint]
        parts = [part.get(joint, np.zeros((len(rows), width))) for width, part in columns]
        table = np.column_stack([model, *parts, white.gap[joint]])
        tables.append(table.T @ table)
    products = np.sum(tables, axis=0)
    roots = [term.prior_root for term in terms]

    def likelihood(errors: tuple[float, float]) -> float:
        sizes = scipy.linalg.block_diag(ledger.errors(errors), *roots)
        inner = sizes.T @ products[:-1, :-1] @ sizes + np.eye(sizes.shape[1])
        root = np.linalg.cholesky(inner)
        taken = np.linalg.solve(root, sizes.T @ products[:-1, -1])
        level = 0.5 * float(taken @ taken) - float(np.sum(np.log(np.diag(root))))
        return level + log_prior_of_errors(errors)

    return max(product(RELATIVE_ERRORS, RELATIVE_ERRORS), key=likelihood)


def climb(comparison: Comparison, start: Sequence[Term]) -> Terms:
    """The set of the highest objective that growing and restarting reach."""
    return _restarted(comparison, _grown(comparison, tuple(start)))[1]


def _restarted(comparison: Comparison, best: Grown) -> Grown:
    """The best of a set that has grown and those that restarts reach; of fewer, as good a one."""
    reached: dict[frozenset[object], Grown] = {}  # by the starts that were tried
    for _ in range(_RESTARTS):
        value, terms = best
        simpler: list[Grown] = []
        for start in _starts(comparison, terms):
            state = _state(start)
            if state not in reached:
                reached[state] = _grown(comparison, start)
            new, others = reached[state]
            if new > value:
                best = new, others
                break
            if len(others) < len(terms) and new > value - _tolerance(comparison, terms, others):
                simpler.append((new, others))
        else:
            if not simpler:
                break
            best = max(simpler, key=itemgetter(0))
    return best


def _starts(comparison: Comparison, terms: Terms) -> Iterator[Terms]:
    """Yield what is left without a term, that with other numbers, and single ones of it.

    What has left may have been made up by the numbers of one of the others.
    """
    if len(terms) < 2:
        return
    for term in sorted(terms, key=lambda term: float(term.visible.max())):
        rest = tuple(other for other in terms if other is not term)
        yield rest
        for place, changed in enumerate(rest):
            others = (*rest[:place], *rest[place + 1 :])
            sets = [(*others, other) for other in comparison.other_numbers(changed, others)]
            if sets:
                yield max(sets, key=comparison.objective)
        if len(rest) > 1:
            yield from ((other,) for other in rest)


def _grown(comparison: Comparison, terms: Terms) -> Grown:
    """The best set on the way from a start: one term added, every one tested again, and so on."""
    best = comparison.objective(terms), terms
    seen: set[frozenset[object]] = set()
    for _ in range(_ROUNDS):
        more = None if _is_full(terms) else comparison.best(terms)
        if more is not None:
            terms = (*terms, more)
            best = max(best, (comparison.objective(terms), terms), key=itemgetter(0))
        if _state(terms) in seen:
            break
        seen.add(_state(terms))
        for term in terms:
            number = next((k for k, other in enumerate(terms) if other is term), None)
            if number is None:
                continue
            others = (*terms[:number], *terms[number + 1 :])
            again = comparison.best(others)
            if again is not None and again.identity == term.identity:
                continue
            new = others if again is None else (*others[:number], again, *others[number:])
            value = comparison.objective(new)
            # Another shape of the same effect only if it is better: shapes are many and alike.
            if again is None or again.key != term.key or value > comparison.objective(terms):
                terms, best = new, max(best, (value, new), key=itemgetter(0))
        if _is_full(terms):
            break
    return best


def _state(terms: Terms) -> frozenset[object]:
    """Candidates and shapes of a set, whatever their order."""
    return frozenset(term.identity for term in terms)


def _is_full(terms: Sequence[Term]) -> bool:
    """Whether a set has as many terms as it may."""
    return sum(term.candidate.kind is not Kind.SIGNAL for term in terms) >= _MOST_TERMS


def _tolerance(comparison: Comparison, terms: Terms, others: Terms) -> float:
    """Evidence that misfit may make at the joints of the terms that stay."""
    kept = _state(others)
    gone = {joint for term in terms if term.identity not in kept for joint in term.columns}
    stay = {joint for term in others for joint in term.columns}
    gaps, residual = comparison.nominal.white.gap, comparison.with_terms(terms).white_residual
    left = np.split(residual, np.cumsum([len(gap) for gap in gaps])[:-1])
    energies = [float(gaps[j] @ gaps[j] - left[j] @ left[j]) for j in gone & stay]
    explained = 0.5 * sum(max(energy, 0.0) for energy in energies)
    return settings.MISFIT_OF_EVIDENCE * explained / settings.TEMPER
