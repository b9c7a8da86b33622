"""Which terms of a selection are causes, which are hints, and what both predict."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from idim_iv_ros.diagnosis.answer.named_model import NamedModel, label, named_model
from idim_iv_ros.diagnosis.comparison import rules
from idim_iv_ros.diagnosis.comparison.candidate import Kind
from idim_iv_ros.diagnosis.comparison.folds import Chosen, chosen_without
from idim_iv_ros.diagnosis.comparison.model_with_terms import ModelWithTerms, Term
from idim_iv_ros.diagnosis.comparison.probability import features, of_set, probability
from idim_iv_ros.diagnosis.comparison.refine import together
from idim_iv_ros.diagnosis.comparison.select import Selection
from idim_iv_ros.diagnosis.identifiability import floor_noise_models
from idim_iv_ros.diagnosis.likelihood import Fit, Regression
from idim_iv_ros.diagnosis.refit.baseline import Baseline
from idim_iv_ros.diagnosis.refit.held_out import HeldOut, held_out
from idim_iv_ros.diagnosis.refit.noise_floor import NoiseFloor, noise_floors, repeats_of
from idim_iv_ros.signals import AutoregressiveModel
from idim_iv_ros.types import FloatArray

INADEQUATE = "most of what remains at its joint is something else"
NO_HELP = "it does not reduce the torque gap on data that it was not fitted to"


@dataclass(frozen=True, eq=False)
class JudgedTerm:
    """A term and how far it is believed.

    Attributes
    ----------
    term : Term
    features : (f,)
        See `comparison.probability`.
    probability : float
        That it is a cause by its first name; that its set holds one decides.
    chosen : str
        Without how many of the folds the search chooses it: ``4 of 4``.
    reason : str
        Why it is no cause; empty where it is one.
    outside : bool
        Whether its torque is there, and it is something else.
    """

    term: Term
    features: FloatArray
    probability: float
    chosen: str
    reason: str
    outside: bool = False


@dataclass(frozen=True, eq=False)
class Explained:
    """What the gap is explained by.

    Attributes
    ----------
    selection : Selection
    effects, numbers : tuple of JudgedTerm
        Causes: of structure, in the order of the stages, and of the nominal numbers.
    doubtful : tuple of JudgedTerm
        Selected and no causes.
    model : NamedModel
        The refit with the structural causes.
    tested : HeldOut
        Held-out residuals of its stages.
    floors : tuple of NoiseFloor
        One for each joint.
    """

    selection: Selection
    effects: tuple[JudgedTerm, ...]
    numbers: tuple[JudgedTerm, ...]
    doubtful: tuple[JudgedTerm, ...]
    model: NamedModel
    tested: HeldOut
    floors: tuple[NoiseFloor, ...]

    def noise(self, refit: Fit) -> tuple[AutoregressiveModel, ...]:
        """Noise models of the refit, no larger than the noise floor."""
        return floor_noise_models(refit, [floor.sigma for floor in self.floors])


def explained(data: Baseline, regression: Regression, selection: Selection) -> Explained:
    """Judge every term of a selection and predict held-out rows with those that are causes.

    Effects that do not help on held-out rows are causes no more, and the others are tested anew.
    """
    judged = judged_terms(data, regression, selection)
    while True:
        found = _tested(data, regression, selection, judged)
        idle = {
            effect.term.key
            for number, effect in enumerate(found.effects)
            if found.tested.gain(number)[0] <= 0.0
        }
        if not idle:
            return found
        judged = [
            replace(judgement, reason=NO_HELP) if judgement.term.key in idle else judgement
            for judgement in judged
        ]


def _tested(
    data: Baseline, regression: Regression, selection: Selection, judged: Sequence[JudgedTerm]
) -> Explained:
    causes = _without_doubtful(selection, [each for each in judged if not each.reason])
    judged = [*causes, *(each for each in judged if each.reason)]
    causes = [cause for cause in causes if not cause.reason]
    effects = [cause for cause in causes if cause.term.candidate.kind is Kind.EFFECT]
    doubtful = [judgement for judgement in judged if judgement.reason]
    outside = [
        each.term for each in doubtful if each.term.candidate.kind is Kind.EFFECT and each.outside
    ]
    others = [term for term in selection.terms if term.candidate.kind in (Kind.NUMBER, Kind.SIGNAL)]
    model = named_model(
        regression,
        [effect.term for effect in effects],
        [*selection.curves, *outside],
        others,
    )
    repeats = repeats_of(data)
    floors = noise_floors(data, model.regression, model.fit, repeats)
    drifts = any(term.effect.family == "time" for term in model.effects)
    labels = [label(data, term) for term in model.effects]
    given = data.prepared.given
    tested = held_out(
        data, model.regression, model.fit, labels, floors, repeats, given, interleaved=drifts
    )
    return Explained(
        selection=selection,
        effects=tuple(effects),
        numbers=tuple(cause for cause in causes if cause.term.candidate.kind is Kind.NUMBER),
        doubtful=tuple(doubtful),
        model=model,
        tested=tested,
        floors=tuple(floors),
    )


def _without_doubtful(selection: Selection, causes: Sequence[JudgedTerm]) -> list[JudgedTerm]:
    """Give causes the numbers that they have where what is doubtful is left out."""
    signals = [term for term in selection.terms if term.candidate.kind is Kind.SIGNAL]
    terms = together(selection.comparison, [*(cause.term for cause in causes), *signals])
    catalogue = selection.comparison.catalogue
    made = []
    for cause, term in zip(causes, terms, strict=False):
        reason = catalogue.why_impossible(
            term.candidate, term.shape, term.coefficients, term.deviations
        )
        made.append(replace(cause, term=term, reason=reason, outside=bool(reason)))
    return made


def judged_terms(data: Baseline, regression: Regression, selection: Selection) -> list[JudgedTerm]:
    """Terms of the catalogue with their probability, those that take most of the gap first."""
    terms = [
        (number, term)
        for number, term in enumerate(selection.terms)
        if term.candidate.kind is not Kind.SIGNAL
    ]
    if not terms:
        return []
    chosen = chosen_without(selection)
    remaining = beyond_noise(data, regression, selection)
    made = []
    for number, term in terms:
        joint = int(np.argmax(term.visible))
        values = features(selection, number, chosen, remaining)
        odds = probability(values, term.key[0])
        made.append(
            JudgedTerm(
                term,
                values,
                odds,
                f"{chosen.times(term)} of {len(chosen.keys)}",
                (
                    reason := _why_not(
                        term, of_set(values, term.key[0]), float(remaining[joint]), chosen
                    )
                ),
                reason == INADEQUATE,
            )
        )
    return sorted(made, key=lambda each: -float(each.term.visible.max()))


def beyond_noise(data: Baseline, regression: Regression, selection: Selection) -> FloatArray:
    """What all terms leave beyond the noise floor, as a share of each joint's torque."""
    fit = regression.fit()
    floors = noise_floors(data, regression, fit, repeats_of(data))
    ledger = selection.comparison.options.ledger
    left = ModelWithTerms(selection.comparison.nominal, selection.terms).residuals(white=False)
    shares = []
    for rest, floor, size in zip(left, floors, ledger.sizes, strict=True):
        square = float(np.mean(rest**2)) - (floor.sigma or 0.0) ** 2
        shares.append(0.0 if floor.sigma is None else np.sqrt(max(square, 0.0)) / size)
    return np.array(shares)


def _why_not(term: Term, odds: float, remaining: float, chosen: Chosen) -> str:
    """Why a term is no cause; empty where it is one."""
    if term.presence < rules.PRESENCE:
        return "it may be misfit of the model"
    share = float(term.whole.max())
    if share < rules.LEAST_SHARE:
        return f"it is {100.0 * share:.2g} % of the torque: too small to matter"
    structural = term.candidate.kind is Kind.EFFECT
    if structural and float(term.visible.max()) < rules.ADEQUATE * remaining:
        return INADEQUATE
    if odds < rules.LEAST_PROBABILITY:
        return (
            f"its probability is {100.0 * odds:.0f} %, and the search without a part of the time "
            f"chooses it in {chosen.times(term)} of {len(chosen.keys)} cases"
        )
    return ""
