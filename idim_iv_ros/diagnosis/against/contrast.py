"""What changed between two sets of recordings: the whole of `diagnose --against`."""

from collections.abc import Collection, Sequence

import numpy as np

from idim_iv_ros.configuration import Configuration
from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.against import words
from idim_iv_ros.diagnosis.against.agreement import agreement
from idim_iv_ros.diagnosis.against.changes import (
    Changes,
    NumberChange,
    changes_between,
    number_changes,
)
from idim_iv_ros.diagnosis.against.law import (
    LawDifference,
    ShiftDifference,
    law_differences,
    shift_difference,
)
from idim_iv_ros.diagnosis.against.sets import TwoSets, two_sets
from idim_iv_ros.diagnosis.comparison.beside import Term
from idim_iv_ros.diagnosis.comparison.candidate import Kind
from idim_iv_ros.diagnosis.comparison.select import refit_residuals
from idim_iv_ros.diagnosis.result import (
    NOT_CALIBRATED,
    ContrastCause,
    ContrastResult,
    EffectParameter,
    Evidence,
    Indistinguishable,
    JointContrast,
    JointTorque,
)
from idim_iv_ros.effects.controller_mismatch import ControllerMismatch
from idim_iv_ros.effects.parametric_effect import ParametricEffect
from idim_iv_ros.effects.time_delay import TimeDelay
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
    return assembly.result([each.recording for each in apart], why_no_law)


class _Assembly:
    """The result from what the steps yield."""

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

    def result(self, disagreeing: Sequence[int], why_no_law: str) -> ContrastResult:
        """Build it; `disagreeing`: recordings of the reference that differ from its others."""
        confirmed = self._changes.confirmed
        numbers = number_changes(self._changes)
        groups = {each.recordings for each in numbers}
        causes = [
            *self._structural_causes(),
            *(self._parametric_cause(each, several=len(groups) > 1) for each in numbers),
            *(self._law_cause(each) for each in self._law),
            *self._delay(),
        ]
        causes.sort(
            key=lambda cause: -max((each.share_of_torque for each in cause.torques), default=0.0)
        )
        joints = self._joints()
        unattributed = tuple(
            words.unattributed(self._data, term, self._scope(term), self._made([term])[0])
            for term in confirmed
            if term.candidate.kind is Kind.CURVE
        )
        differs = bool(causes or unattributed)
        unexplained = [
            each
            for joint, each in enumerate(joints)
            if differs and each.unexplained >= settings.CONTRAST_LEAST_SHARE * self._sizes[joint]
        ]
        first = len(self._sets.sets[0].motions)
        reference, against = tuple(self._bags[:first]), tuple(self._bags[first:])
        alone = [[self._bags[k] for k in sorted(group)] for group in groups]
        notes = [
            words.shift(self._shift),
            *words.softened(self._sets.softened, self._data.joints),
            words.groups(sorted(alone)),
            words.reference_disagrees([self._bags[number] for number in disagreeing]),
            why_no_law,
        ]
        return ContrastResult(
            reference=reference,
            against=against,
            differs=differs,
            sentence=words.summary(
                self._data, against, causes, unattributed, unexplained, joints, differs=differs
            ),
            joints=tuple(joints),
            causes=tuple(causes),
            unattributed=unattributed,
            common=tuple(
                words.common(self._data, term)
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

    def _evidence(self, terms: Sequence[Term]) -> Evidence:
        chosen = [self._changes.chosen.get(id(term), "") for term in terms]
        return Evidence(
            statistic=sum(max(2.0 * term.evidence, 0.0) for term in terms),
            p_value=None,
            held_out_gain=None,
            folds_positive="",
            chosen_in_folds=min(chosen),
            p_value_from=NOT_CALIBRATED,
        )

    def _others(self, terms: Sequence[Term]) -> tuple[Indistinguishable, ...]:
        joints = self._data.joints
        found = {}
        for term in terms:
            for key, weight in term.rivals:
                if key[:3] != term.key[:3] and weight >= settings.LEAST_WEIGHT_OF_RIVAL:
                    found[key[:2]] = weight
        return tuple(
            Indistinguishable(effect, None if joint is None else joints[joint], weight)
            for (effect, joint), weight in found.items()
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
        shared = any(term.key[:3] == terms[0].key[:3] for term in self._changes.common)
        both = bool(numbers["reference"]) and bool(numbers["against"])
        change = "changed" if shared or both else ("appeared" if numbers["against"] else "vanished")
        parameters = numbers["against"] or numbers["reference"]
        if both:
            parameters = _difference(numbers["against"], numbers["reference"])
        torques, others = self._made(terms), self._others(terms)
        return ContrastCause(
            effect=name,
            kind="structural",
            joint=data.joints[place.joint],
            other_joint=None if place.other is None else data.joints[place.other],
            change=change,  # type: ignore[arg-type]
            bags=tuple(self._bags[number] for number in sorted(self._sets.second)),
            parameters=parameters,
            reference=numbers["reference"],
            against=numbers["against"],
            evidence=self._evidence(terms),
            indistinguishable_from=others,
            torques=torques,
            sentence=words.structural(data, name, place, change, numbers, torques, others),
        )

    def _made(self, terms: Sequence[Term]) -> tuple[JointTorque, ...]:
        """RMS of their torque over the rows on which they act, where it matters."""
        data = self._data
        place = terms[0].candidate.place
        joint = None if place is None else place.joint
        made = []
        for number, (name, size) in enumerate(zip(data.joints, self._sizes, strict=True)):
            torque = np.zeros(len(data.recordings[number]))
            inside = np.zeros(len(torque), dtype=bool)
            for term in terms:
                inside |= np.isin(data.recordings[number], list(term.candidate.scope or ()))
                if number in term.columns:
                    torque += term.columns[number] @ term.coefficients
            rms = float(np.sqrt(np.mean(torque[inside] ** 2))) if inside.any() else 0.0
            if number == joint or rms >= settings.CONTRAST_LEAST_SHARE * size:
                made.append((number != joint, JointTorque(name, rms, rms / size)))
        made.sort(key=lambda each: (each[0], -each[1].share_of_torque))
        return tuple(torque for _, torque in made)

    def _parametric_cause(self, change: NumberChange, *, several: bool) -> ContrastCause:
        data = self._data
        bags = tuple(self._bags[number] for number in sorted(change.recordings))
        parameters = change.parameters(self._changes)
        if change.joint is not None:
            parameters = data.in_units_at(change.joint, parameters)
        torques, others = self._made(change.terms), self._others(change.terms)
        return ContrastCause(
            effect=change.effect.name,
            kind="parametric",
            joint=None if change.joint is None else data.joints[change.joint],
            change="changed",
            bags=bags,
            parameters=parameters,
            evidence=self._evidence(change.terms),
            indistinguishable_from=others,
            torques=torques,
            sentence=words.parametric(
                data, change.effect, change.joint, parameters, torques, others,
                bags if several else (),
            ),
        )  # fmt: skip

    def _law_cause(self, difference: LawDifference) -> ContrastCause:
        joint, data = self._data.joints[difference.joint], self._data
        numbers = [
            data.in_units_at(difference.joint, each)
            for each in (difference.change, difference.reference, difference.against)
        ]
        torque = JointTorque(
            joint, difference.torque, difference.torque / self._sizes[difference.joint]
        )
        return ContrastCause(
            effect=ControllerMismatch.name,
            kind="structural",
            joint=joint,
            change="changed",
            bags=tuple(self._bags[number] for number in sorted(self._sets.second)),
            parameters=numbers[0],
            reference=numbers[1],
            against=numbers[2],
            evidence=Evidence(difference.statistic, None, None, "", p_value_from=NOT_CALIBRATED),
            torques=(torque,),
            sentence=words.law(joint, numbers[1], numbers[2], torque),
        )

    def _delay(self) -> list[ContrastCause]:
        if not self._shift.is_delay:
            return []
        change = self._shift.change
        assert change.std is not None
        statistic = (change.value / change.std) ** 2
        return [
            ContrastCause(
                effect=TimeDelay.name,
                kind="structural",
                joint=None,
                change="changed",
                bags=tuple(self._bags[number] for number in sorted(self._sets.second)),
                parameters={"delay": change},
                reference={"delay": self._shift.reference},
                against={"delay": self._shift.against},
                evidence=Evidence(statistic, None, None, "", p_value_from=NOT_CALIBRATED),
                sentence=words.delay(self._shift),
            )
        ]

    def _joints(self) -> list[JointContrast]:
        """RMS in the second set: of the reference's model, with the causes, with its own."""
        model = self._changes.selection.model
        ledger = model.nominal.options.ledger
        left = model.residuals(white=False)
        of_reference = [rest.copy() for rest in left]
        for term in (*self._changes.selection.terms, *self._changes.selection.curves):
            if term.candidate.scope is None:
                continue
            for joint, torque in self._moved(term).items():
                of_reference[joint] = of_reference[joint] + torque
        inside = self._sets.inside
        own = refit_residuals(
            ledger, [rest * rows for rest, rows in zip(left, inside, strict=True)], inside
        )
        made = []
        for joint, name in enumerate(self._data.joints):
            first, second, least = (
                float(np.sqrt(np.mean(rest[joint][inside[joint]] ** 2)))
                for rest in (of_reference, left, own)
            )
            least = min(least, second)
            made.append(
                JointContrast(
                    name,
                    first,
                    second,
                    least,
                    float(np.sqrt(max(first**2 - least**2, 0.0))) / self._sizes[joint],
                    float(np.sqrt(max(second**2 - least**2, 0.0))),
                )
            )
        return made

    def _moved(self, term: Term) -> dict[int, FloatArray]:
        """What the second set's torque (r_j,) has beyond the reference's model by a term."""
        if self._scope(term) == "against":
            return {j: rows @ term.coefficients for j, rows in term.columns.items()}
        if term.candidate.kind is Kind.NUMBER or term.shape is None:
            return {}
        everywhere = self._changes.selection.comparison.catalogue.everywhere(
            term.candidate, term.shape
        )
        return {
            j: -(rows @ term.coefficients) * self._sets.inside[j] for j, rows in everywhere.items()
        }


def _difference(
    against: dict[str, EffectParameter], reference: dict[str, EffectParameter]
) -> dict[str, EffectParameter]:
    """Number by number, of those that both have."""
    made = {}
    for name, each in against.items():
        other = reference.get(name)
        if other is not None:
            determined = each.std is not None and other.std is not None
            std = float(np.hypot(each.std or 0.0, other.std or 0.0)) if determined else None
            made[name] = EffectParameter(each.value - other.value, std, each.unit)
    return made
