"""What changed between two sets of recordings: the whole of `diagnose --against`."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
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
from idim_iv_ros.diagnosis.against.sets import TwoSets, two_sets
from idim_iv_ros.diagnosis.answer.causes import rivals_of
from idim_iv_ros.diagnosis.comparison.candidate import Kind
from idim_iv_ros.diagnosis.comparison.model_with_terms import Term
from idim_iv_ros.diagnosis.comparison.select import refit_residuals
from idim_iv_ros.diagnosis.controller import law_change, shown_law, why_not_checked
from idim_iv_ros.diagnosis.likelihood import Columns
from idim_iv_ros.diagnosis.refit.command_rows import CommandRows
from idim_iv_ros.diagnosis.result import (
    ContrastCause,
    ContrastResult,
    EffectParameter,
    Evidence,
    JointContrast,
    JointTorque,
)
from idim_iv_ros.effects.parametric_effect import ParametricEffect
from idim_iv_ros.effects.registry import CONTROL_LAW, name_of
from idim_iv_ros.recording import Recording
from idim_iv_ros.simulation import ControlLaw
from idim_iv_ros.types import FloatArray

Side = Literal["reference", "against"]


def contrasted(
    reference: Sequence[Recording],
    against: Sequence[Recording],
    configuration: Configuration,
    without: Collection[str] = (),
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
    numbers = [sets.second]
    if len(sets.second) > 1:
        numbers += [frozenset({number}) for number in sorted(sets.second)]
    scopes = [sets.first, sets.second]
    changes = changes_between(sets.data, sets.regression, scopes, numbers, without)
    first = sets.refits[0]
    among_reference = agreement(first.data, first.regression, (), without)
    disagreeing = [recording.bag for recording in among_reference if not recording.agrees]
    return contrast_of(sets, changes, disagreeing, without)


def contrast_of(
    sets: TwoSets, changes: Changes, disagreeing: Sequence[str], without: Collection[str]
) -> ContrastResult:
    """Build the document from the terms that act in some recordings only.

    Parameters
    ----------
    disagreeing
        Recordings of the reference that differ from its others.
    """
    data, against = sets.data, sets.bags(sets.second)
    numbers = number_changes(changes)
    groups = sorted(sets.bags(group) for group in {change.recordings for change in numbers})
    law, why_no_law = _law_causes(sets, without)
    shifts = {
        name: EffectParameter(refit.shift.shift, refit.shift.std, "s")
        for name, refit in zip(("reference", "against"), sets.refits, strict=True)
    }
    delay = _delay_causes(sets, shifts)
    causes = [
        *_structural_causes(sets, changes),
        *(_parametric_cause(sets, changes, change, len(groups) > 1) for change in numbers),
        *law,
        *delay,
    ]
    causes.sort(key=lambda cause: -max((t.share_of_torque for t in cause.torques), default=0.0))
    unattributed = tuple(
        words.unattributed(data, term, _side(sets, term), _torques(sets, [term])[0])
        for term in changes.accepted
        if term.candidate.kind is Kind.CURVE
    )
    joints, of_reference = _joints(sets, changes)
    least = settings.LEAST_NONPARAMETRIC * sets.sizes
    unexplained = [
        joint for joint, size in zip(joints, least, strict=True) if joint.unexplained >= size
    ]
    differs = bool(causes or unattributed or unexplained)
    if differs:
        closest = [(term, times) for term, times in changes.doubtful.items() if times]
        sentence = words.changes(data, against, causes, unattributed, unexplained, closest)
    else:
        noisier = {
            joint.joint: level
            for joint, level, size in zip(joints, of_reference, least, strict=True)
            if joint.after**2 - level**2 >= size**2
        }
        sentence = words.no_difference(data, against, joints, noisier)
    notes = [
        "" if delay else words.shift(shifts),
        *words.softened([refit.softened for refit in sets.refits], data.joints),
        words.groups(groups),
        words.reference_disagrees(disagreeing),
        why_no_law,
    ]
    return ContrastResult(
        reference=sets.bags(sets.first),
        against=against,
        differs=differs,
        sentence=sentence,
        joints=tuple(joints),
        causes=tuple(causes),
        unattributed=unattributed,
        common=tuple(
            words.common(data, term)
            for term in changes.common
            if term.candidate.kind in (Kind.EFFECT, Kind.CURVE)
        ),
        effort_shift=shifts,
        notes=tuple(note for note in notes if note),
    )


def _side(sets: TwoSets, term: Term) -> Side:
    """The set whose recordings a term acts in."""
    assert term.candidate.scope is not None
    return "against" if term.candidate.scope <= sets.second else "reference"


def _evidence(changes: Changes, terms: Sequence[Term]) -> Evidence:
    return Evidence(
        sum(max(2.0 * term.evidence, 0.0) for term in terms),
        chosen_in_folds=min(changes.accepted[term] for term in terms),
    )


def _torques(
    sets: TwoSets, terms: Sequence[Term], recordings: frozenset[int] | None = None
) -> tuple[JointTorque, ...]:
    """RMS of their torque in the recordings where they act, at joints where it matters."""
    data, place = sets.data, terms[0].candidate.place
    inside = recordings or frozenset().union(*(t.candidate.scope or () for t in terms))
    first = None if place is None else data.joints[place.joint]
    made = [
        JointTorque(name, float(rms), float(rms / size))
        for name, rms, size in zip(
            data.joints, rms_of(data, terms, inside), sets.sizes, strict=True
        )
        if name == first or rms >= settings.LEAST_NONPARAMETRIC * size
    ]
    return tuple(sorted(made, key=lambda torque: (torque.joint != first, -torque.share_of_torque)))


def _structural_causes(sets: TwoSets, changes: Changes) -> list[ContrastCause]:
    """One cause of every effect that one set has, or that the sets have otherwise."""
    data, made = sets.data, []
    places: dict[tuple[str, int | None, int | None], list[Term]] = {}
    for term in changes.accepted:
        if term.candidate.kind is Kind.EFFECT:
            places.setdefault(term.key[:3], []).append(term)
    for place, terms in sorted(places.items()):
        first = terms[0]
        numbers: dict[Side, dict[str, EffectParameter]] = {"reference": {}, "against": {}}
        for term in terms:
            fitted = term.effect.parameters(term.shape, term.coefficients, term.deviations)
            numbers[_side(sets, term)] = data.in_units_at(term.place.joint, fitted)
        one, other = numbers["reference"], numbers["against"]
        change: Literal["appeared", "vanished", "changed"] = "appeared" if other else "vanished"
        if (one and other) or any(term.key[:3] == place for term in changes.common):
            change = "changed"
        joints = [data.joints[joint] for joint in first.place.joints]
        cause = ContrastCause(
            effect=first.effect.name,
            kind="structural",
            joint=joints[0],
            other_joint=joints[1] if len(joints) > 1 else None,
            change=change,
            bags=sets.bags(sets.second),
            parameters=_difference(other, one) if one and other else other or one,
            reference=one,
            against=other,
            evidence=_evidence(changes, terms),
            indistinguishable_from=rivals_of(data.joints, terms),
            torques=_torques(sets, terms),
            sentence="",
        )
        made.append(replace(cause, sentence=words.structural(data, cause)))
    return made


def _parametric_cause(
    sets: TwoSets, changes: Changes, change: NumberChange, several: bool
) -> ContrastCause:
    """Numbers that changed; `several`: not all recordings of the second set have these."""
    data, joint, parameters = sets.data, change.joint, change.parameters
    cause = ContrastCause(
        effect=change.effect.name,
        kind="parametric",
        joint=None if joint is None else data.joints[joint],
        change="changed",
        bags=sets.bags(change.recordings),
        parameters=parameters if joint is None else data.in_units_at(joint, parameters),
        evidence=_evidence(changes, change.terms),
        indistinguishable_from=rivals_of(data.joints, change.terms),
        torques=_torques(sets, change.terms, change.recordings),
        sentence="",
    )
    which = "" if joint is None else change.effect.which(joint)
    return replace(cause, sentence=words.parametric(data, cause, which, several=several))


def _law_causes(sets: TwoSets, without: Collection[str]) -> tuple[list[ContrastCause], str]:
    """Compare the law that each set shows; and why not, where they cannot be compared.

    The configured law is only the form: what both sets have otherwise than configured cancels.
    """
    if CONTROL_LAW.name in without:
        return [], ""
    for refit, name in zip(sets.refits, ("reference", "second set"), strict=True):
        reason = why_not_checked(refit.data)
        if reason:
            return [], f"the control laws of the sets were not compared: {reason} ({name})"
    one, other = (shown_law(refit.data) for refit in sets.refits)
    causes = [
        _law_cause(sets, one.law, joint, one.joints[joint][0].followed_by(other.joints[joint][0]))
        for joint in sorted(set(one.joints) & set(other.joints))
    ]
    return [cause for cause in causes if cause is not None], ""


def _law_cause(
    sets: TwoSets, law: ControlLaw, joint: int, rows: CommandRows
) -> ContrastCause | None:
    """What one joint is controlled by otherwise in the second set; None where in nothing."""
    change = law_change(rows)
    differing = [term for term in change.terms if term.key[3] is not None]
    if not differing:
        return None
    groups: tuple[dict[str, tuple[float, float]], ...] = {}, {}
    torque = np.zeros(len(rows.rest))
    for term in differing:
        name, value = term.key[0], float(term.coefficients[0])
        common, std = change.changes.get(name, (0.0, 0.0))
        groups[0][name] = common, std
        groups[1][name] = common + value, float(np.hypot(std, term.deviations[0]))
        torque += value * rows.groups[name]
    reference, against = (
        sets.data.in_units_at(joint, CONTROL_LAW.parameters(law, joint, group)) for group in groups
    )
    # What the change makes on the second set's motion.
    rms = float(np.std(torque[rows.second]))
    made = JointTorque(sets.data.joints[joint], rms, rms / float(sets.sizes[joint]))
    cause = ContrastCause(
        effect=CONTROL_LAW.name,
        kind="structural",
        joint=made.joint,
        change="changed",
        bags=sets.bags(sets.second),
        parameters=_difference(against, reference),
        reference=reference,
        against=against,
        evidence=Evidence(2.0 * sum(term.evidence for term in differing)),
        torques=(made,),
        sentence="",
    )
    return replace(cause, sentence=words.law(cause))


def _delay_causes(sets: TwoSets, shifts: Mapping[str, EffectParameter]) -> list[ContrastCause]:
    """A shift of the effort that changed by more than recording makes of it."""
    reference, against = ({"delay": shifts[name]} for name in ("reference", "against"))
    change = _difference(against, reference)
    delay = change["delay"]
    period = max(refit.shift.period for refit in sets.refits)
    if delay.std is None or abs(delay.value) < max(
        settings.CONTRAST_LEAST_DELAY * period, settings.CLEAR_DEVIATIONS * delay.std
    ):
        return []
    cause = ContrastCause(
        effect=name_of("delay"),
        kind="structural",
        joint=None,
        change="changed",
        bags=sets.bags(sets.second),
        parameters=change,
        reference=reference,
        against=against,
        evidence=Evidence((delay.value / delay.std) ** 2),
        sentence=words.delay(delay),
    )
    return [cause]


def _difference(
    against: Mapping[str, EffectParameter], reference: Mapping[str, EffectParameter]
) -> dict[str, EffectParameter]:
    """Second set less reference, of the numbers that both have; no deviation unless both have."""
    made = {}
    for name, other in against.items():
        if name not in reference:
            continue
        one, std = reference[name], None
        if one.std is not None and other.std is not None:
            std = float(np.hypot(one.std, other.std))
        made[name] = EffectParameter(other.value - one.value, std, other.unit)
    return made


def _joints(sets: TwoSets, changes: Changes) -> tuple[list[JointContrast], list[float]]:
    """RMS in the second set of three models, and of the whole one in the reference.

    The three: that of the reference, with the causes, and with numbers of the second set alone, in
    each part of the time as the other parts have them. What is left in the reference is that of
    white noise at the second set's rate.
    """
    model = changes.selection.model
    after = model.residuals(white=False)
    before = [rest.copy() for rest in after]
    for term in model.terms:
        for joint, torque in _moved(sets, changes, term).items():
            before[joint] += torque
            if term in changes.doubtful:
                after[joint] += torque
    alone = _with_numbers_of_second(sets, changes, after)
    rates = [
        min(motion.signals.rate for motion in refit.data.prepared.motions) for refit in sets.refits
    ]
    noise = float(np.sqrt(max(1.0, rates[0] / rates[1])))  # fewer samples in a row: more noise
    made, of_reference = [], []
    for joint, (name, inside) in enumerate(zip(sets.data.joints, sets.inside, strict=True)):
        first, second, least = (_rms(rest[joint][inside]) for rest in (before, after, alone))
        least = min(least, second)
        share = float(np.sqrt(max(first**2 - least**2, 0.0)) / sets.sizes[joint])
        unexplained = float(np.sqrt(second**2 - least**2))
        made.append(JointContrast(name, first, second, least, share, unexplained))
        of_reference.append(noise * _rms(after[joint][~inside]))
    return made, of_reference


def _with_numbers_of_second(
    sets: TwoSets, changes: Changes, residuals: Sequence[FloatArray]
) -> list[FloatArray]:
    """(r_j,) what numbers of the second set leave of parts that they are not fitted to."""
    ledger = changes.selection.comparison.options.ledger
    part = quarters(sets.data, ledger)
    made = [rest.copy() for rest in residuals]
    for number in np.unique(part):
        out = [part[blocks] == number for blocks in ledger.blocks]
        fitted = [rows & ~gone for rows, gone in zip(sets.inside, out, strict=True)]
        left = refit_residuals(ledger, residuals, fitted)
        for joint, gone in enumerate(out):
            made[joint][gone] = left[joint][gone]
    return made


def _moved(sets: TwoSets, changes: Changes, term: Term) -> dict[int, FloatArray]:
    """What the second set's torque (r_j,) has beyond the reference's model by a term."""
    candidate, shape, sign = term.candidate, term.shape, 1.0
    columns: Columns = term.columns
    if candidate.scope is None:
        return {}
    if _side(sets, term) == "reference":
        if shape is None or isinstance(candidate.effect, ParametricEffect):
            return {}
        columns, sign = changes.selection.comparison.catalogue.everywhere(candidate, shape), -1.0
    return {
        joint: sign * (rows @ term.coefficients) * sets.inside[joint]
        for joint, rows in columns.items()
    }


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else 0.0
