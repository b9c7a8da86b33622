"""Which terms of a selection are causes, the refit with the effects among them, and the rest."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from idim_iv_ros.diagnosis import sentences, settings
from idim_iv_ros.diagnosis.comparison.candidate import Kind
from idim_iv_ros.diagnosis.comparison.folds import chosen_without
from idim_iv_ros.diagnosis.comparison.model_with_terms import Term
from idim_iv_ros.diagnosis.comparison.probability import (
    FEATURES,
    LEAST_GAIN,
    LIMITS,
    features,
    of_set,
    probability,
)
from idim_iv_ros.diagnosis.comparison.refine import stopped_by_physics, together
from idim_iv_ros.diagnosis.comparison.select import Selection
from idim_iv_ros.diagnosis.refit.baseline import Baseline, rows_of, with_parameters
from idim_iv_ros.diagnosis.refit.command_rows import events_in
from idim_iv_ros.diagnosis.refit.held_out import HeldOut, held_out
from idim_iv_ros.diagnosis.refit.noise_floor import NoiseFloor, Repeat, noise_floors, repeats_of
from idim_iv_ros.diagnosis.result.causes import Unexplained
from idim_iv_ros.diagnosis.result.document import Stage
from idim_iv_ros.diagnosis.where import above_noise
from idim_iv_ros.effects.cause import Parameters
from idim_iv_ros.effects.effect import Shape
from idim_iv_ros.effects.registry import BY_NAME
from idim_iv_ros.estimation.likelihood import Fit, Regression, rms
from idim_iv_ros.statistics.residuals import excess_kurtosis
from idim_iv_ros.types import FloatArray

_LEAST_EVENT_ROWS = 200  # from which on events are looked for
_MORE_STEPS = 2  # of the noise models, from those of the model before
_SHAPE_STEP = 0.01  # of the number of a shape
_USUAL_SHAPE = 1.0  # relative deviation of the numbers of a shape, before anything is recorded
_COEFFICIENT_STEP = 1e-4  # of the coefficient
NO_HELP = "it does not reduce the torque gap on data that it was not fitted to"
_ON_TIME = "the effort of its joint is as late as those of the others"
_NO_SIZE = "beside new values of all numbers its size may as well be zero"


@dataclass(frozen=True, eq=False)
class AssessedTerm:
    """A term and how far it is believed.

    `probability`: that it is a cause by its first name; that its set holds one decides, and is
    `too_unsure` where nothing but this speaks against it.
    """

    term: Term
    features: FloatArray  # see `comparison.probability`
    probability: float
    chosen: str  # without how many of the folds the search chooses it, ``4 of 4``
    reason: str  # why it is no cause; empty where it is one
    outside: bool = False  # whether its torque is there, and it is something else
    too_unsure: float | None = None


@dataclass(frozen=True, eq=False)
class Explained:
    """What the gap is explained by: causes, and the refit with those that are effects.

    What the catalogue does not explain is `outside`: free curves, and effects that are not
    adequate. The `whole` fit has what of this matters, and numbers that no base parameters hold.
    """

    selection: Selection
    effects: tuple[AssessedTerm, ...]  # causes of structure, in the order of the stages
    numbers: tuple[AssessedTerm, ...]  # causes of the nominal model; last those it does not give
    doubtful: tuple[AssessedTerm, ...]  # selected and no causes
    outside: tuple[Term, ...]
    regression: Regression  # of the refit, with one block for each effect
    fits: tuple[Fit, ...]  # of the refit, and with the first, the first two … effects
    whole: Fit
    tested: HeldOut  # held-out residuals of the stages
    floors: tuple[NoiseFloor, ...]  # one for each joint

    @property
    def data(self) -> Baseline:
        """The refit that candidates are added to."""
        return self.selection.catalogue.data

    @property
    def fit(self) -> Fit:
        """With all effects."""
        return self.fits[-1]

    def parameters_of(self, number: int) -> Parameters:
        """Numbers of one of the effects that mean something to an engineer.

        They have the coefficients that the effect has beside nominal errors. Deviations hold what
        the shape leaves open. With it fixed, an excess of friction is known to a percent; a
        Stribeck speed that is a little higher with less excess fits as well. The shape is moved a
        little in every direction that the search may take, the change of the torque is fitted
        beside everything else, and the covariance of all is carried over to the numbers that an
        engineer reads. The search ends on a grid: how far the fit would still move a number counts
        as its error, too.
        """
        term, block = self.effects[number].term, self.regression.blocks[number]
        inner = self.fit.coefficient_covariance[block, block]
        fixed = np.sqrt(np.maximum(np.diag(inner), 0.0))
        # Of what the refit has in its base parameters the search knows how precise it is.
        fixed = np.where(fixed > 0.0, fixed, term.deviations)
        numbers = term.effect.parameters(term.shape, term.coefficients, fixed)
        near: dict[tuple[bool, ...], Shape] = {}  # one for each number, or those that move together
        if term.effect.free_shape:
            covered = self.data.covered[term.place.joint]
            for other in term.effect.neighbours(term.shape, _SHAPE_STEP, covered):
                moved = np.not_equal(other.numbers, term.shape.numbers)
                if moved.any():
                    near.setdefault(tuple(moved), other)
        if not near:
            return numbers
        shapes = [term.shape, *near.values()]
        covariance, further = self._with_free_shape(term, block, shapes)
        slopes = _slopes(term, fixed, shapes)
        variances = np.einsum("pi,ij,pj->p", slopes, covariance, slopes) + (slopes @ further) ** 2
        return {
            name: replace(number, std=float(np.sqrt(variance)) if variance > 0.0 else None)
            for (name, number), variance in zip(numbers.items(), variances, strict=True)
        }

    def _with_free_shape(
        self, term: Term, block: slice, shapes: Sequence[Shape]
    ) -> tuple[FloatArray, FloatArray]:
        """Covariance of an effect's k coefficients beside m moves of its shape, (k + m, k + m).

        And by how much the fit would still move each of them, (k + m,). `block`: the effect's
        columns in the refit; `shapes`: that of the term, and it moved.
        """
        fit, effect = self.fit, term.effect
        # Of the torque that the fit leaves to the model, as `knee` has it.
        of_the_fit = with_parameters(self.data, fit.values) if effect.beyond_knee else self.data
        here, *moved = rows_of(of_the_fit, effect, term.place, shapes)
        changes = {
            joint: np.column_stack([(rows[joint] - plain) @ term.coefficients for rows in moved])
            for joint, plain in here.items()
        }
        wider = self.regression.with_columns(changes).fit(fit.noise_models, steps=0)
        places = np.r_[block, len(fit.coefficients) : len(wider.coefficients)]
        further = wider.coefficients[places]
        further[: term.width] -= term.coefficients
        covariance = wider.coefficient_covariance[np.ix_(places, places)]
        # Directions that the recording leaves open end where sizes and shapes usually do.
        usual = scipy.linalg.block_diag(
            term.prior_root @ term.prior_root.T,
            np.eye(len(moved)) * (_USUAL_SHAPE / _SHAPE_STEP) ** 2,
        )
        open_share = covariance @ np.linalg.pinv(covariance + usual)
        return covariance - open_share @ covariance, further - open_share @ further


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


def matters(term: Term) -> bool:
    """Whether what lies outside the catalogue is large enough to be said."""
    return float(term.visible[term.place.joint]) >= settings.LEAST_NONPARAMETRIC


def explained(selection: Selection, on_time: Collection[tuple[str, int]] = ()) -> Explained:
    """Judge every term of a selection and predict held-out rows with those that are causes.

    `on_time`: effects at joints of which their signals show that there is none.

    Effects that do not help on held-out rows, or whose size may be zero, are causes no more, and
    the others are tested anew. New numbers that are all free are a hard test on a short recording:
    an effect that beside likely errors of the given ones predicts every part of the time stays.
    """
    repeats = repeats_of(selection.catalogue.data)
    assessed = _assessed_terms(selection, repeats)
    idle = {one.term.key: _ON_TIME for one in assessed if one.term.key[:2] in on_time}
    while True:
        assessed = [
            replace(one, reason=one.reason or idle.get(one.term.key, "")) for one in assessed
        ]
        explanation = _tested(selection, assessed, repeats)
        idle = {}
        for number, effect in enumerate(explanation.effects):
            helps = explanation.tested.helps(number, effect.term.place.joint)
            if not helps and not _predicts_all_parts(effect):
                idle[effect.term.key] = NO_HELP
            elif _may_be_zero(explanation, number):
                idle[effect.term.key] = _NO_SIZE
        if not idle:
            return explanation


def _predicts_all_parts(effect: AssessedTerm) -> bool:
    """Whether every part of the time is predicted better with an effect, beside nominal errors."""
    return float(effect.features[FEATURES.index(LEAST_GAIN)]) > 0.0


def _may_be_zero(explanation: Explained, number: int) -> bool:
    """Whether the interval of the only number of an effect holds zero."""
    unsure = [one for one in explanation.parameters_of(number).values() if one.std is not None]
    if len(unsure) != 1:
        return False
    return abs(unsure[0].value) < settings.NORMAL_95 * (unsure[0].std or 0.0)


def _tested(
    selection: Selection, assessed: Sequence[AssessedTerm], repeats: Sequence[Repeat]
) -> Explained:
    """Fit the refit with the causes one after the other, and predict held-out rows.

    Causes have the numbers that they have where what is doubtful is left out.
    """
    catalogue, data = selection.catalogue, selection.catalogue.data
    causes = [one for one in assessed if not one.reason]
    alone = [*(cause.term for cause in causes), *selection.signals]
    for number, term in enumerate(together(selection.comparison, alone)[: len(causes)]):
        reason = catalogue.why_impossible(
            term.candidate, term.shape, term.coefficients, term.deviations
        )
        causes[number] = replace(causes[number], term=term, reason=reason, outside=bool(reason))
    effects, numbers = (
        tuple(one for one in causes if not one.reason and one.term.candidate.kind is kind)
        for kind in (Kind.EFFECT, Kind.NUMBER)
    )
    doubtful = tuple(one for some in (causes, assessed) for one in some if one.reason)
    regression = data.regression
    fits = [regression.fitted]
    for effect in effects:
        regression = regression.with_columns(effect.term.columns)
        fits.append(regression.fit(fits[-1].noise_models, steps=_MORE_STEPS))
    outside = [d.term for d in doubtful if d.term.is_effect and d.outside]
    outside = [*selection.curves, *outside]
    more = [term.columns for term in outside if matters(term)]
    more += [
        term.columns
        for term in selection.terms
        if term.candidate.kind is Kind.SIGNAL
        or term.candidate.is_no_base_parameter(catalogue.space)
    ]
    tested = held_out(
        data,
        regression,
        fits[-1],
        [f"+{e.term.effect.name}[{data.joints[e.term.place.joint]}]" for e in effects],
        repeats,
        interleaved=any(effect.term.effect.family == "time" for effect in effects),
    )
    beside = [one.term for one in (*effects, *numbers)]
    return Explained(
        selection=selection,
        effects=effects,
        numbers=(*numbers, *_not_given(selection, beside, fits[-1])),
        doubtful=doubtful,
        outside=tuple(outside),
        regression=regression,
        fits=tuple(fits),
        whole=regression.with_columns(*more).fit(fits[-1].noise_models) if more else fits[-1],
        tested=tested,
        floors=tuple(noise_floors(data, fits[-1], repeats)),
    )


def _not_given(selection: Selection, causes: Sequence[Term], fit: Fit) -> tuple[AssessedTerm, ...]:
    """Numbers of which the nominal model says nothing, where the recording shows them.

    `causes`: of structure and of the nominal numbers, beside which they are taken; `fit`: of the
    refit with the effects: says how precise they are.
    """
    comparison, count = selection.comparison, len(fit.values)
    sizes = comparison.options.ledger.sizes
    errors = comparison.with_terms((*causes, *selection.signals)).errors
    made = []
    for candidate in comparison.catalogue.not_given:
        directions = np.column_stack([change.direction[:count] for change in candidate.changes])
        inverse = np.linalg.pinv(directions)
        values, spread = inverse @ errors, inverse @ fit.covariance[:count, :count] @ inverse.T
        columns = {joint: lines.T.astype(float) for joint, lines in candidate.lines.items()}
        whole = np.zeros(len(sizes))
        for joint, table in columns.items():
            whole[joint] = rms(table @ values) / sizes[joint]
        evidence = 0.5 * float(values @ np.linalg.pinv(spread) @ values)
        deviations = np.sqrt(np.diag(spread))
        small = whole.max() < settings.LEAST_SHARE or evidence < settings.LEAST_SUPPORT
        if small or comparison.catalogue.why_impossible(candidate, Shape(), values, deviations):
            continue
        term = Term(
            candidate=candidate,
            shape=Shape(),
            columns=columns,
            coefficients=values,
            deviations=deviations,
            basis=np.eye(len(values)),
            evidence=evidence,
            whole=whole,
        )
        made.append(AssessedTerm(term, np.zeros(0), LIMITS[1], "", ""))
    return tuple(made)


def _assessed_terms(selection: Selection, repeats: Sequence[Repeat]) -> list[AssessedTerm]:
    """Terms of the catalogue with their probability, those that take most of the gap first.

    Last those in whose place a free curve is likelier.
    """
    displaced = []
    for term, curve in selection.displaced:
        described = sentences.nonparametric(selection.catalogue.data, curve)
        displaced.append(AssessedTerm(term, np.zeros(0), 0.0, "", f"{described}, is likelier"))
    if len(selection.terms) == len(selection.signals):
        return displaced
    data, chosen, made = selection.catalogue.data, chosen_without(selection), []
    # What all terms leave beyond the noise floor, as a share of each joint's torque.
    left = selection.comparison.with_terms(selection.terms).residuals
    remaining = np.zeros(len(data.joints))
    for joint, floor in enumerate(noise_floors(data, data.regression.fitted, repeats)):
        if floor.sigma is not None:
            square = float(np.mean(left[joint] ** 2)) - floor.sigma**2
            remaining[joint] = np.sqrt(max(square, 0.0)) / data.torque_sizes[joint]
    for number, term in enumerate(selection.terms):
        if term.candidate.kind is Kind.SIGNAL:
            continue
        values = features(selection, number, chosen, remaining)
        times = f"{chosen.times(term)} of {len(chosen.keys)}"
        beyond = float(remaining[int(np.argmax(term.visible))])
        reason, outside = _why_no_cause(term, beyond)
        if term.is_effect and not reason:
            reason = stopped_by_physics(selection.comparison, selection.terms, number)
            outside = bool(reason)
        # What may be an error of the signals as well is no cause by that part of its set.
        of_signals = sum(weight for key, weight in term.rivals if key.effect not in BY_NAME)
        whole = of_set(values, term.key.effect) * (1.0 - of_signals)
        unsure = whole if not reason and whole < settings.LEAST_PROBABILITY else None
        if unsure is not None:
            reason = sentences.too_unsure(unsure, times)
        odds = probability(values, term.key.effect)
        made.append(AssessedTerm(term, values, odds, times, reason, outside, unsure))
    return sorted(made, key=lambda one: -float(one.term.visible.max())) + displaced


def _why_no_cause(term: Term, beyond: float) -> tuple[str, bool]:
    """Why a term is no cause, empty where it may be one; whether its torque is something else's.

    `beyond`: what remains beyond the noise at its joint, as a share of the torque.
    """
    if term.presence < settings.PRESENCE:
        return "it may be misfit of the model", False
    share = float(term.whole.max())
    if share < settings.LEAST_SHARE:
        return f"it is {100.0 * share:.2g} % of the torque: too small to matter", False
    if term.is_effect and float(term.visible.max()) < settings.ADEQUATE * beyond:
        return "most of what remains at its joint is something else", True
    return "", False


def unexplained(explanation: Explained) -> Unexplained | None:
    """Describe the largest residual outside the catalogue; None where there is none.

    Where a joint's gap is its noise nothing is unexplained, whatever the shape of the noise.
    """
    data = explanation.data
    loud = [
        joint
        for joint, floor in enumerate(explanation.floors)
        if joint not in data.left_out and above_noise(explanation.fit.residuals[joint], floor)
    ]
    outside = [term for term in explanation.outside if matters(term) and term.place.joint in loud]
    largest = max(outside, key=lambda term: term.evidence, default=None)
    if largest is not None:
        joint = largest.place.joint
        # A function that leaves the events takes what follows from them: the law answers.
        both = _events(data, explanation.whole, joint) and _events(data, explanation.fit, joint)
        return both or _described(explanation, largest)
    events = filter(None, (_events(data, explanation.whole, joint) for joint in loud))
    return max(events, key=lambda event: event.share, default=None)


def unexplained_residual(
    explanation: Explained, stages: Sequence[Stage]
) -> list[tuple[int, float, float, float]]:
    """Joints at which the last model misses much: (joint, rms, share of the torque, noise).

    The largest share first. Less than a percent of the torque is not much, however little the
    nominal model misses; nor is what errors take that no base parameters hold, which no stage has.
    """
    data, first, last = explanation.data, stages[0], stages[-1]
    missed = []
    for joint, (name, floor) in enumerate(zip(data.joints, explanation.floors, strict=True)):
        rest = last.torque_rms[name]
        share = rest / data.torque_sizes[joint]
        of_gap = rest > settings.UNEXPLAINED_OF_GAP * first.torque_rms[name]
        much = share > settings.UNEXPLAINED_OF_TORQUE or of_gap
        if not much or share < settings.LEAST_NONPARAMETRIC or joint in data.left_out:
            continue
        left, noise = min(rest, float(np.std(explanation.whole.residuals[joint]))), floor.sigma
        if noise is not None and left > settings.UNEXPLAINED_OVER_NOISE * noise:
            missed.append((joint, rest, share, noise))
    return sorted(missed, key=lambda joint: -joint[2])


def _described(explanation: Explained, term: Term) -> Unexplained:
    """A term outside the catalogue, with its share of the energy of the whitened residual."""
    data, joint = explanation.data, term.place.joint
    noise, segments = explanation.whole.noise_models[joint], data.rows[joint].segments
    before, after = (
        float(np.sum(noise.standardized(fit.residuals[joint], segments) ** 2))
        for fit in (explanation.fit, explanation.whole)
    )
    return Unexplained(
        joint=data.joints[joint],
        family=term.effect.family,
        share=max(1.0 - after / max(before, 1e-300), 0.0),
        where=sentences.nonparametric(data, term),
    )


def _events(data: Baseline, fit: Fit, joint: int) -> Unexplained | None:
    """Short events that do not repeat: the whitened residual has far too many large values."""
    rows = data.rows[joint]
    white = fit.noise_models[joint].standardized(fit.residuals[joint], rows.segments)
    energy = white**2
    total = float(energy.sum())
    if total <= 0.0 or len(white) < _LEAST_EVENT_ROWS:
        return None
    most = np.sort(energy)[-max(1, round(settings.EVENT_SAMPLES * len(energy))) :]
    share = float(most.sum()) / total
    if excess_kurtosis(white) < settings.EVENT_KURTOSIS or share < settings.EVENT_ENERGY:
        return None
    size = float(np.sqrt(share * np.mean(fit.residuals[joint] ** 2)))
    if size < settings.LEAST_NONPARAMETRIC * data.torque_sizes[joint]:
        return None
    largest, recording = int(np.argmax(energy)), data.recordings[joint]
    time = data.counting(joint, [motion.elapsed[motion.decimation.kept] for motion in data.motions])
    first = (int(recording[largest]), float(time[largest]))
    more = [(event.recording, event.begin) for event in events_in(white, recording, time)]
    return Unexplained(
        joint=data.joints[joint],
        family="event",
        share=share,
        where=sentences.events(data, joint, share, first, more),
    )
