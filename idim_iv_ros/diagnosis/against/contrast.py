"""What changed between two sets of recordings: the whole of `diagnose --against`."""

from collections.abc import Collection, Mapping, Sequence
from typing import Literal

import numpy as np

from idim_iv_ros.configuration import Configuration
from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.against import words
from idim_iv_ros.diagnosis.against.changes import (
    Changes,
    NumberChange,
    agreement,
    changes_between,
    number_changes,
    quarters,
    rms_of,
)
from idim_iv_ros.diagnosis.against.law import (
    LawDifference,
    ShiftDifference,
    law_differences,
    less,
    shift_difference,
)
from idim_iv_ros.diagnosis.against.sets import TwoSets, two_sets
from idim_iv_ros.diagnosis.comparison.candidate import Kind, Scope
from idim_iv_ros.diagnosis.comparison.model_with_terms import Term
from idim_iv_ros.diagnosis.comparison.select import refit_residuals
from idim_iv_ros.diagnosis.result import (
    ContrastCause,
    ContrastResult,
    EffectParameter,
    Evidence,
    Indistinguishable,
    JointContrast,
    JointTorque,
)
from idim_iv_ros.effects.parametric_effect import ParametricEffect
from idim_iv_ros.effects.registry import name_of
from idim_iv_ros.progress import Progress
from idim_iv_ros.recording import Recording
from idim_iv_ros.types import FloatArray


def contrasted(
    reference: Sequence[Recording],
    against: Sequence[Recording],
    configuration: Configuration,
    without: Collection[str] = (),
    progress: Progress | None = None,
) -> ContrastResult:
    """Say what changed from the reference recordings to the others.

    Base parameters and effects that both sets share are fitted to both, so that errors of the
    nominal model cancel. What one set has is looked for in its recordings alone.

    Parameters
    ----------
    without
        Effects that are left out of the catalogue.

    Raises
    ------
    UsageError, DataError
        As `identify`, for each set.
    """
    sets = two_sets(reference, against, configuration)
    first = frozenset(range(len(sets.sets[0].motions)))
    numbers = [sets.second]
    if len(sets.second) > 1:
        numbers += [frozenset({number}) for number in sorted(sets.second)]
    changes = changes_between(sets.data, sets.regression, [first, sets.second], numbers, without)
    apart = agreement(sets.sets[0], sets.regression_of_reference, (), without)
    law, why_no_law = law_differences(sets, without)
    assembly = _Assembly(sets, changes, law, shift_difference(sets))
    return assembly.result(
        [agreement.bag for agreement in apart if not agreement.agrees], why_no_law
    )


class _Assembly:
    """The result from what the steps found."""

    def __init__(
        self,
        sets: TwoSets,
        changes: Changes,
        law: Sequence[LawDifference],
        shift: ShiftDifference,
    ) -> None:
        self._sets, self._data, self._changes = sets, sets.data, changes
        self._law, self._shift = law, shift
        self._bags = [part.bag for part in self._data.prepared.session.parts]
        second = [
            rows.torque[inside] for rows, inside in zip(self._data.rows, sets.inside, strict=True)
        ]
        self._sizes = [max(float(np.sqrt(np.mean(torque**2))), 1e-300) for torque in second]

    def result(self, disagreeing: Sequence[str], why_no_law: str) -> ContrastResult:
        """Build it; `disagreeing`: recordings of the reference that differ from its others."""
        data, terms = self._data, self._changes.selection.terms
        numbers = number_changes(self._changes)
        groups = {change.recordings for change in numbers}
        causes = [
            *self._structural_causes(),
            *(self._parametric_cause(change, several=len(groups) > 1) for change in numbers),
            *(self._law_cause(difference) for difference in self._law),
            *self._delay(),
        ]
        causes.sort(
            key=lambda cause: (
                -max((torque.share_of_torque for torque in cause.torques), default=0.0)
            )
        )
        unattributed = tuple(
            words.unattributed(data, term, self._scope(term), self._made([term])[0])
            for term in self._changes.confirmed
            if term.candidate.kind is Kind.CURVE
        )
        joints, of_reference = self._joints()
        unexplained = [
            joint
            for joint, size in zip(joints, self._sizes, strict=True)
            if joint.unexplained >= settings.LEAST_NONPARAMETRIC * size
        ]
        noisier = {
            joint.joint: level
            for joint, level, size in zip(joints, of_reference, self._sizes, strict=True)
            if joint.after**2 - level**2 >= (settings.LEAST_NONPARAMETRIC * size) ** 2
        }
        differs = bool(causes or unattributed or unexplained)
        first = len(self._sets.sets[0].motions)
        reference, against = tuple(self._bags[:first]), tuple(self._bags[first:])
        if differs:
            doubtful = [term for term in terms if self._is_doubtful(term)]
            closest = [(term, self._changes.chosen[id(term)]) for term in doubtful]
            sentence = words.changes(data, against, causes, unattributed, unexplained, closest)
        else:
            sentence = words.no_difference(data, against, joints, noisier)
        notes = [
            words.shift(self._shift),
            *words.softened(self._sets.softened, data.joints),
            words.groups(sorted([self._bags[k] for k in sorted(group)] for group in groups)),
            words.reference_disagrees(disagreeing),
            why_no_law,
        ]
        return ContrastResult(
            reference=reference,
            against=against,
            differs=differs,
            sentence=sentence,
            joints=tuple(joints),
            causes=tuple(causes),
            unattributed=unattributed,
            common=tuple(
                words.common(data, term)
                for term in self._changes.common
                if term.candidate.kind in (Kind.EFFECT, Kind.CURVE)
            ),
            effort_shift={"reference": self._shift.reference, "against": self._shift.against},
            notes=tuple(note for note in notes if note),
        )

    def _scope(self, term: Term) -> str:
        """``reference`` or ``against``."""
        assert term.candidate.scope is not None
        return "against" if term.candidate.scope <= self._sets.second else "reference"

    def _is_doubtful(self, term: Term) -> bool:
        """Whether a term of some recordings was selected and not confirmed."""
        return term.candidate.scope is not None and not any(
            term is other for other in self._changes.confirmed
        )

    def _cause(
        self,
        effect: str,
        joint: int | None,
        numbers: Sequence[Mapping[str, EffectParameter]],
        evidence: Sequence[Term] | float,
        torques: Sequence[JointTorque],
        sentence: str,
        change: Literal["appeared", "vanished", "changed"] = "changed",
        *,
        other_joint: str | None = None,
        parametric: bool = False,
        recordings: Scope | None = None,
    ) -> ContrastCause:
        """One cause.

        Parameters
        ----------
        numbers
            Of the change and, where they are known, of the reference and of the second set.
        evidence
            Terms of the search, or a Wald statistic.
        recordings
            Of the second set; None: all.
        """
        terms = [] if isinstance(evidence, float) else evidence
        changed, reference, against = [*(dict(number) for number in numbers), {}, {}][:3]
        return ContrastCause(
            effect=effect,
            kind="parametric" if parametric else "structural",
            joint=None if joint is None else self._data.joints[joint],
            other_joint=other_joint,
            change=change,
            bags=tuple(self._bags[k] for k in sorted(recordings or self._sets.second)),
            parameters=changed,
            reference=reference,
            against=against,
            evidence=Evidence(
                evidence
                if isinstance(evidence, float)
                else sum(max(2.0 * term.evidence, 0.0) for term in terms),
                chosen_in_folds=min((self._changes.chosen[id(term)] for term in terms), default=""),
            ),
            indistinguishable_from=self._others(terms),
            torques=tuple(torques),
            sentence=sentence,
        )

    def _others(self, terms: Sequence[Term]) -> tuple[Indistinguishable, ...]:
        joints = self._data.joints
        weights = {
            key[:2]: weight
            for term in terms
            for key, weight in term.rivals
            if key[:3] != term.key[:3] and weight >= settings.LEAST_WEIGHT_OF_RIVAL
        }
        return tuple(
            Indistinguishable(effect, None if joint is None else joints[joint], weight)
            for (effect, joint), weight in weights.items()
        )

    def _structural_causes(self) -> list[ContrastCause]:
        """One cause of every effect that one set has, or that the sets have otherwise."""
        places: dict[tuple[str, int | None, int | None], list[Term]] = {}
        for term in self._changes.confirmed:
            if term.candidate.kind is Kind.EFFECT:
                places.setdefault(term.key[:3], []).append(term)
        return [self._structural_cause(terms) for _, terms in sorted(places.items())]

    def _structural_cause(self, terms: Sequence[Term]) -> ContrastCause:
        data, place = self._data, terms[0].candidate.place
        assert place is not None
        name = terms[0].candidate.effect.name
        numbers: dict[str, dict[str, EffectParameter]] = {"reference": {}, "against": {}}
        for term in terms:
            effect = term.candidate.effect
            assert not isinstance(effect, ParametricEffect)
            found = effect.parameters(term.shape, term.coefficients, term.deviations)
            numbers[self._scope(term)] = data.in_units_at(place.joint, found)
        one, other = numbers["reference"], numbers["against"]
        change: Literal["appeared", "vanished", "changed"] = "appeared" if other else "vanished"
        if (one and other) or any(t.key[:3] == terms[0].key[:3] for t in self._changes.common):
            change = "changed"
        changed = less(other, one) if one and other else other or one
        torques, others = self._made(terms), self._others(terms)
        return self._cause(
            name,
            place.joint,
            (changed, one, other),
            terms,
            torques,
            words.structural(data, name, place, change, numbers, torques, others),
            change,
            other_joint=None if place.other is None else data.joints[place.other],
        )

    def _made(self, terms: Sequence[Term], recordings: Scope | None = None) -> list[JointTorque]:
        """RMS of their torque in the recordings where they act, at joints where it matters."""
        data, place = self._data, terms[0].candidate.place
        inside = recordings or frozenset().union(*(t.candidate.scope or () for t in terms))
        own = None if place is None else data.joints[place.joint]
        made = [
            JointTorque(name, float(rms), float(rms) / size)
            for name, rms, size in zip(
                data.joints, rms_of(data, terms, inside), self._sizes, strict=True
            )
            if name == own or rms >= settings.LEAST_NONPARAMETRIC * size
        ]
        return sorted(made, key=lambda each: (each.joint != own, -each.share_of_torque))

    def _parametric_cause(self, change: NumberChange, *, several: bool) -> ContrastCause:
        data, name, joint = self._data, change.effect.name, change.joint
        parameters = change.parameters(self._changes)
        if joint is not None:
            parameters = data.in_units_at(joint, parameters)
        torques = self._made(change.terms, change.recordings)
        bags = [self._bags[k] for k in sorted(change.recordings)] if several else ()
        others = self._others(change.terms)
        return self._cause(
            name,
            joint,
            (parameters,),
            change.terms,
            torques,
            words.parametric(data, change.effect, joint, parameters, torques, others, bags),
            parametric=True,
            recordings=change.recordings,
        )

    def _law_cause(self, difference: LawDifference) -> ContrastCause:
        joint, rms = difference.joint, difference.torque
        numbers = [
            self._data.in_units_at(joint, each)
            for each in (difference.change, difference.reference, difference.against)
        ]
        torque = JointTorque(self._data.joints[joint], rms, rms / self._sizes[joint])
        sentence = words.law(torque, numbers[1], numbers[2])
        return self._cause(
            name_of("gains"), joint, numbers, difference.statistic, [torque], sentence
        )

    def _delay(self) -> list[ContrastCause]:
        if not self._shift.is_delay:
            return []
        change = self._shift.change
        assert change.std is not None
        shifts = (change, self._shift.reference, self._shift.against)
        statistic = (change.value / change.std) ** 2
        numbers = [{"delay": shift} for shift in shifts]
        return [
            self._cause(name_of("delay"), None, numbers, statistic, (), words.delay(self._shift))
        ]

    def _joints(self) -> tuple[list[JointContrast], list[float]]:
        """RMS in the second set of three models, and of the whole one in the reference.

        The three: that of the reference, with the causes beside it, and with numbers of the second
        set's own, in each part of the time as the other parts have them. What is left in the
        reference is that of white noise at the second set's rate.
        """
        model = self._changes.selection.model
        after, inside = model.residuals(white=False), self._sets.inside
        before = [rest.copy() for rest in after]
        for term in model.terms:
            for joint, torque in self._moved(term).items():
                before[joint] += torque
                if self._is_doubtful(term):
                    after[joint] += torque
        own = self._with_own_numbers(after)
        slower = max(1.0, self._rate(0) / self._rate(1))  # fewer samples in a row: more noise
        made, of_reference = [], []
        for joint, (name, size) in enumerate(zip(self._data.joints, self._sizes, strict=True)):
            first, second, least = (
                _rms(rest[joint][inside[joint]]) for rest in (before, after, own)
            )
            least = min(least, second)
            share = float(np.sqrt(max(first**2 - least**2, 0.0))) / size
            unexplained = float(np.sqrt(second**2 - least**2))
            made.append(JointContrast(name, first, second, least, share, unexplained))
            of_reference.append(float(np.sqrt(slower)) * _rms(after[joint][~inside[joint]]))
        return made, of_reference

    def _rate(self, number: int) -> float:
        """Hz at which one of the sets was recorded."""
        return min(motion.signals.rate for motion in self._sets.sets[number].prepared.motions)

    def _with_own_numbers(self, residuals: Sequence[FloatArray]) -> list[FloatArray]:
        """(r_j,) what numbers of the second set leave of parts that they are not fitted to."""
        ledger = self._changes.selection.comparison.options.ledger
        part = quarters(self._data, ledger)
        made = [rest.copy() for rest in residuals]
        for number in np.unique(part):
            out = [part[blocks] == number for blocks in ledger.blocks]
            fitted = [rows & ~gone for rows, gone in zip(self._sets.inside, out, strict=True)]
            left = refit_residuals(ledger, residuals, fitted)
            for joint, gone in enumerate(out):
                made[joint][gone] = left[joint][gone]
        return made

    def _moved(self, term: Term) -> dict[int, FloatArray]:
        """What the second set's torque (r_j,) has beyond the reference's model by a term."""
        if term.candidate.scope is None:
            return {}
        if self._scope(term) == "against":
            return {j: rows @ term.coefficients for j, rows in term.columns.items()}
        if term.shape is None:
            return {}
        catalogue = self._changes.selection.comparison.catalogue
        everywhere = catalogue.everywhere(term.candidate, term.shape)
        return {
            j: -(rows @ term.coefficients) * self._sets.inside[j] for j, rows in everywhere.items()
        }


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else 0.0
