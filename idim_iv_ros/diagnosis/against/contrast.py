"""What changed between two sets of recordings: the whole of `diagnose --against`.

Both are one regression, each on the motion and the loads of its own refit. Everything that differs
between the sets enters their rows: a payload of the second set changes the load that a
load-dependent friction of both sees, and its closed loop moves otherwise. So each set has a refit,
simulated motion and alignment of the effort of its own, in one processing; only then are their rows
put under one another.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from idim_iv_ros.configuration import Configuration
from idim_iv_ros.diagnosis import sentences, settings
from idim_iv_ros.diagnosis.against.changes import (
    Changes,
    NumberChange,
    changes_between,
    number_changes,
    quarters,
    rms_of,
)
from idim_iv_ros.diagnosis.answer.causes import rivals_of
from idim_iv_ros.diagnosis.comparison.candidate import Catalogue, Kind, Scope
from idim_iv_ros.diagnosis.comparison.curves import Nonparametric
from idim_iv_ros.diagnosis.comparison.model_with_terms import Term
from idim_iv_ros.diagnosis.comparison.select import refit_residuals
from idim_iv_ros.diagnosis.controller import law_change, shown_law, why_not_checked
from idim_iv_ros.diagnosis.refit.baseline import Baseline, proposals, refit_of, rows_of
from idim_iv_ros.diagnosis.refit.refit import Refit, on_likelier_motion
from idim_iv_ros.diagnosis.result.causes import Evidence
from idim_iv_ros.diagnosis.result.recordings import (
    ContrastCause,
    ContrastResult,
    JointContrast,
    JointTorque,
)
from idim_iv_ros.diagnosis.sentences import listed_numbers, spaced, torque, with_interval
from idim_iv_ros.effects.cause import EffectParameter, Parameters
from idim_iv_ros.effects.registry import BY_NAME, CONTROL_LAW, name_of
from idim_iv_ros.estimation.likelihood import Columns, rms
from idim_iv_ros.identification.prepare import prepare
from idim_iv_ros.identification.sanity import ANOTHER_UNIT, in_smaller_units
from idim_iv_ros.recording.recording import Recording, Session, session_of
from idim_iv_ros.types import BoolArray, FloatArray

_FOLLOWS = 0.5  # of the energy of an effort
_WHERE = {"reference": "in the reference recordings only", "against": "in the second set only"}


@dataclass(frozen=True)
class TwoSets:
    """Rows of both sets, those of the reference first."""

    data: Baseline  # of all recordings; its estimate is the reference's
    refits: tuple[Refit, Refit]  # of reference and second set by themselves
    # Joints whose efforts are not torques of one robot, and why: their rows are left out.
    not_compared: dict[int, str]
    first: Scope  # numbers of the reference's recordings in `data`
    second: Scope  # and of the second set's
    inside: tuple[BoolArray, ...]  # rows (r_j,) of the second set, for each joint
    sizes: FloatArray  # RMS (n_joints,) of the torque in the second set, N m (N)

    def bags(self, numbers: Scope) -> tuple[str, ...]:
        """Names of some recordings."""
        parts = self.data.prepared.session.parts
        return tuple(parts[number].bag for number in sorted(numbers))


def two_sets(
    reference: Sequence[Recording], against: Sequence[Recording], configuration: Configuration
) -> TwoSets:
    """Refit each set by itself and put their rows under one another; errors as `identify`.

    The noisier set limits the band, and all rows come at one rate.
    """
    for section in proposals((reference, against), configuration):
        whole, sets = prepare([*reference, *against], section), []
        place_of = {id(recording): place for place, recording in enumerate(whole.recordings)}
        for part in (reference, against):  # filtered as all recordings are; its time starts at zero
            session = session_of(part)
            places = [place_of[id(recording)] for recording in session.recordings]
            factors = tuple(whole.cutoffs.factors[place] for place in places)
            motions = tuple(whole.motions[place] for place in places)
            cutoffs = replace(whole.cutoffs, factors=factors)
            prepared = replace(whole, session=session, cutoffs=cutoffs, motions=motions)
            sets.append(refit_of(prepared))
        if all(data.sticking for data in sets):
            break
    refits = on_likelier_motion(sets[0]), on_likelier_motion(sets[1])
    first, second = (refit.data for refit in refits)
    why = _not_compared(first, second)
    one, other = first.prepared, second.prepared
    parts = (*one.session.parts, *other.session.parts)
    prepared = replace(
        one,
        session=Session((*one.recordings, *other.recordings), parts, ()),
        cutoffs=replace(one.cutoffs, factors=(*one.cutoffs.factors, *other.cutoffs.factors)),
        motions=(*one.motions, *other.motions),
    )
    joints = tuple(
        replace(rows.joined([more]), left_out=joint in why)
        for joint, (rows, more) in enumerate(zip(first.rows, second.rows, strict=True))
    )
    data = replace(
        first,
        prepared=prepared,
        regression=replace(first.regression, joints=joints),
        sticking=first.sticking and second.sticking,
    ).on((*first.motions, *second.motions))
    count = len(first.motions)
    numbers = frozenset(range(count)), frozenset(range(count, len(data.motions)))
    inside = tuple(recording >= count for recording in data.recordings)
    torques = [rows.torque[some] for rows, some in zip(data.rows, inside, strict=True)]
    sizes = np.maximum([rms(torque) for torque in torques], 1e-300)
    return TwoSets(data, refits, why, *numbers, inside, sizes)


def _not_compared(reference: Baseline, second: Baseline) -> dict[int, str]:
    """Joints whose efforts are not torques of one robot in both sets, and why.

    A set is judged by itself first. Then its effort may follow what the numbers of the reference
    need on its motion, but in a smaller unit, at most joints or where in_smaller_units says so: no
    robot changes so.
    """
    why: dict[int, str] = {}
    for data, name in ((reference, "the reference"), (second, "the second set")):
        for finding in data.prepared.joint_findings:
            if finding.left_out:
                why.setdefault(finding.joint, f"in {name} {finding.sentence}")
    ratios: dict[int, float] = {}
    for joint, rows in enumerate(second.rows):
        needed = rows.prediction(reference.estimate.linear.values)
        common, energy = float(needed @ rows.torque), float(needed @ needed)
        if joint not in why and common**2 > _FOLLOWS * energy * float(rows.torque @ rows.torque):
            ratios[joint] = common / energy
    of_all = float(np.median(list(ratios.values()))) if ratios else 1.0
    sizes = dict(enumerate(second.torque_sizes.tolist()))
    for joint in ratios if of_all > ANOTHER_UNIT else in_smaller_units(ratios, sizes):
        why[joint] = (
            f"in the second set the effort is {ratios[joint]:.2g} times what the reference needs "
            "for such a motion, and follows it: another unit?"
        )
    return why


def contrasted(
    reference: Sequence[Recording],
    against: Sequence[Recording],
    configuration: Configuration,
    without: Collection[str] = (),
) -> ContrastResult:
    """Say what changed from the reference recordings to the others; errors as `identify`.

    Base parameters and effects that both sets share are fitted to both, so that errors of the
    nominal model cancel. What one set has is looked for in its recordings alone.

    `without`: effects that are left out of the catalogue.
    """
    sets = two_sets(reference, against, configuration)
    numbers = [sets.second]
    if len(sets.second) > 1:
        numbers += [frozenset({number}) for number in sorted(sets.second)]
    scopes = [sets.first, sets.second]
    changes = changes_between(Catalogue(sets.data, without).differing(scopes, numbers))
    return contrast_of(sets, changes, without)


def contrast_of(sets: TwoSets, changes: Changes, without: Collection[str]) -> ContrastResult:
    """Build the document from the terms that act in some recordings only."""
    data, against, names = sets.data, sets.bags(sets.second), sets.data.joints
    numbers = number_changes(changes)
    law, why_no_law = _law_causes(sets, without)
    shifts = {name: refit.shift.common for name, refit in zip(_WHERE, sets.refits, strict=True)}
    delay = _delay_causes(sets, shifts)
    parametric = _parametric_causes(sets, changes, numbers)
    law = [cause for cause in law if not _scaled_alike(cause, parametric)]
    causes = [*_structural_causes(sets, changes), *parametric, *law, *delay]
    causes.sort(key=lambda cause: -max((t.share_of_torque for t in cause.torques), default=0.0))
    unattributed = []
    for term in changes.accepted:
        if isinstance(term.candidate.effect, Nonparametric):
            made = _torques_of(sets, [term])[0]
            unattributed.append(
                f"the recordings differ at {made.joint} by {torque(data, made.rms, made.joint)}, a "
                f"torque that {term.candidate.effect.words}, {_WHERE[_side_of(sets, term)]}; "
                "nothing in the catalogue explains it"
            )
    joints, of_reference = _joints(sets, changes)
    least = settings.LEAST_NONPARAMETRIC * np.delete(sets.sizes, list(sets.not_compared))
    unexplained = [one for one, size in zip(joints, least, strict=True) if one.unexplained >= size]
    reasons = sets.not_compared.items()
    not_compared = tuple(f"{names[joint]} is not compared: {why}" for joint, why in reasons)
    differs = bool(causes or unattributed or unexplained) or (None if not_compared else False)
    if differs:
        said = (*(cause.sentence for cause in causes), *unattributed)
        parts = [f"What changed from the reference recordings to {', '.join(against)}:"]
        parts += map(sentences.as_sentence, said)
        left = ", ".join(
            f"at {one.joint} by {torque(data, one.unexplained, one.joint)}" for one in unexplained
        )
        closest = [f"{_in_words(data, t)} (in {n})" for t, n in changes.doubtful.items() if n]
        if left:
            nothing = "nothing else" if said else "nothing"
            parts.append(f"The recordings differ {left}; {nothing} in the catalogue explains it.")
        if left and closest:
            parts.append(
                f"Closest comes {', '.join(closest)}, which is not chosen again whenever a part "
                "of the time is left out."
            )
        sentence = " ".join(parts)
    else:
        sentence = _no_difference(data, ", ".join(against), joints, of_reference, least)
    groups = sorted(sets.bags(group) for group in {change.recordings for change in numbers})
    apart = "; ".join(map(", ".join, groups)) if len(groups) > 1 else ""
    notes = [
        "" if delay else _shift(shifts),
        *(
            f"{name}: {refit.turning.sentence(names)}"
            for name, refit in zip(("the reference", "the second set"), sets.refits, strict=True)
            if refit.turning.soft
        ),
        apart and f"the recordings of the second set do not agree and were compared apart: {apart}",
        why_no_law,
    ]
    named = (Kind.EFFECT, Kind.CURVE)
    return ContrastResult(
        reference=sets.bags(sets.first),
        against=against,
        differs=differs,
        sentence=" ".join([sentence, *map(sentences.as_sentence, not_compared)]),
        not_compared=not_compared,
        joints=tuple(joints),
        causes=tuple(causes),
        unattributed=tuple(unattributed),
        common=tuple(_in_words(data, t) for t in changes.common if t.candidate.kind in named),
        effort_shift=shifts,
        notes=tuple(note for note in notes if note),
    )


def _structural_causes(sets: TwoSets, changes: Changes) -> list[ContrastCause]:
    """One cause of every effect that one set has, or that the sets have otherwise."""
    data, made = sets.data, []
    places: dict[tuple[str, int | None, int | None], dict[str, Term]] = {}
    for term in changes.accepted:
        if term.is_effect:
            places.setdefault(term.key[:3], {})[_side_of(sets, term)] = term
    for place, sides in sorted(places.items(), key=lambda item: item[0]):
        terms = list(sides.values())
        one, other = (
            data.in_units_at(term.place.joint, term.parameters) if term else {}
            for term in map(sides.get, _WHERE)
        )
        joints = [data.joints[joint] for joint in terms[0].place.joints]
        text = f"{spaced(place[0])} at {' and '.join(joints)}"
        said, said_other = (listed_numbers(place[0], of_set) for of_set in (one, other))
        change = "changed"
        if one and other:
            text += f" changed: {said} in the reference, {said_other} in the second set"
        elif any(term.key[:3] == place for term in changes.common):
            more = "reference recordings" if one else "second set"
            text += f" changed: more of it in the {more} ({said or said_other})"
        else:
            change = "appeared" if other else "vanished"
            text += f" {_WHERE['reference' if one else 'against']}: {said or said_other}"
        fields: dict[str, Any] = dict(zip(("joint", "other_joint"), joints, strict=False))
        numbers = (one, other)
        made.append(_of_terms(sets, changes, terms, text, change=change, numbers=numbers, **fields))
    return made


def _parametric_causes(
    sets: TwoSets, changes: Changes, numbers: Sequence[NumberChange]
) -> list[ContrastCause]:
    """One cause of all numbers of an effect that changed, with its recordings where they differ."""
    several = len({change.recordings for change in numbers}) > 1
    made = []
    for number in numbers:
        joint, parameters, bags = number.joint, number.parameters, sets.bags(number.recordings)
        effect, name, place = number.effect.name, None, ""
        if joint is not None:
            name, parameters = sets.data.joints[joint], sets.data.in_units_at(joint, parameters)
            place = f" of {name}{number.effect.which(joint)}"
        text = (
            f"{', '.join(bags) + ': ' if several else ''}{spaced(effect)}{place} "
            f"changed, second set less reference: {listed_numbers(effect, parameters)}"
        )
        more = {"kind": "parametric", "joint": name, "bags": bags, "parameters": parameters}
        made.append(_of_terms(sets, changes, number.terms, text, number.recordings, **more))
    return made


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
    (commands, _, first), (_, _, second) = (shown_law(refit.data) for refit in sets.refits)
    causes = []
    for joint in sorted(set(first) & set(second) - set(sets.not_compared)):
        rows = first[joint].every.followed_by(second[joint].every)
        shown = law_change(rows)
        differing = [term for term in shown.terms if term.key.scope]
        if not differing:
            continue
        groups: tuple[dict[str, tuple[float, float]], ...] = {}, {}
        command = np.zeros(len(rows.rest))
        for term in differing:
            name, value = term.key.effect, float(term.coefficients[0])
            common, std = shown.changes.get(name, (0.0, 0.0))
            groups[0][name] = common, std
            groups[1][name] = common + value, float(np.hypot(std, term.deviations[0]))
            command += value * rows.groups[name]
        one, other = (
            sets.data.in_units_at(joint, CONTROL_LAW.parameters(commands.law, joint, group))
            for group in groups
        )
        # What the change makes on the second set's motion.
        size = float(np.std(command[rows.second]))
        made = JointTorque(sets.data.joints[joint], size, size / float(sets.sizes[joint]))
        changed = ", ".join(
            f"{spaced(name)} from {with_interval(one[name])} to {with_interval(number)}"
            for name, number in other.items()
        )
        text = (
            f"control law of {made.joint} changed: {changed} "
            f"({100.0 * made.share_of_torque:.3g} % of its torque)"
        )
        evidence = Evidence(2.0 * sum(term.evidence for term in differing))
        more = {"joint": made.joint, "torques": (made,), "sentence": text, "evidence": evidence}
        causes.append(_cause(sets, CONTROL_LAW.name, (one, other), **more))
    return causes, ""


def _scaled_alike(law: ContrastCause, numbers: Sequence[ContrastCause]) -> bool:
    """Whether the torque gain of a joint explains its change of law.

    A gain of what is recorded changes all commands by its inverse: then both are one cause.
    """
    for cause in numbers:
        factor = cause.parameters.get("factor")
        gain = BY_NAME[cause.effect].part == "torque scale" and cause.joint == law.joint
        if factor is not None and gain:
            return bool(law.against) and all(
                abs(factor.value * other.value - law.reference[name].value)
                < settings.NORMAL_95
                * np.hypot(factor.value * (other.std or 0.0), (factor.std or 0.0) * other.value)
                for name, other in law.against.items()
            )
    return False


def _delay_causes(sets: TwoSets, shifts: Mapping[str, EffectParameter]) -> list[ContrastCause]:
    """A shift of the effort that changed by more than recording makes of it."""
    numbers = {"delay": shifts["reference"]}, {"delay": shifts["against"]}
    delay = _difference(numbers[1], numbers[0])["delay"]
    least = settings.CONTRAST_LEAST_DELAY * max(refit.shift.period for refit in sets.refits)
    if delay.std is None or abs(delay.value) < max(least, settings.CLEAR_DEVIATIONS * delay.std):
        return []
    sentence = (
        f"the effort acts {1e3 * abs(delay.value):.2f} ± "
        f"{1e3 * settings.NORMAL_95 * delay.std:.2g} ms "
        f"{'later' if delay.value > 0.0 else 'earlier'} in the second set, at all joints"
    )
    evidence = Evidence((delay.value / delay.std) ** 2)
    return [_cause(sets, name_of("delay"), numbers, evidence=evidence, sentence=sentence)]


def _of_terms(
    sets: TwoSets,
    changes: Changes,
    terms: Sequence[Term],
    text: str,
    recordings: Scope | None = None,
    **fields: Any,
) -> ContrastCause:
    """A cause that terms of the search are; `text`: what changed, without its torques."""
    torques = _torques_of(sets, terms, recordings)
    listed = ", ".join(
        f"{torque(sets.data, made.rms, made.joint)} at {made.joint} "
        f"({100.0 * made.share_of_torque:.3g} % of its torque)"
        for made in torques
    )
    others = rivals_of(sets.data.joints, terms)
    statistic = sum(max(2.0 * term.evidence, 0.0) for term in terms)
    times = min(changes.accepted[term] for term in terms)
    return _cause(
        sets,
        terms[0].key.effect,
        evidence=Evidence(statistic, chosen_in_folds=times),
        indistinguishable_from=others,
        torques=torques,
        sentence=f"{text}{listed and f'; that is {listed}'}{sentences.or_else(others)}",
        **fields,
    )


def _cause(
    sets: TwoSets, effect: str, numbers: tuple[Parameters, Parameters] = ({}, {}), **fields: Any
) -> ContrastCause:
    """A cause with its numbers in the reference and in the second set, where they are known."""
    one, other = numbers
    usual = {
        "kind": "structural",
        "joint": None,
        "change": "changed",
        "bags": sets.bags(sets.second),
        "parameters": _difference(other, one) if one and other else other or one,
    }
    return ContrastCause(effect=effect, reference=one, against=other, **{**usual, **fields})


def _difference(against: Parameters, reference: Parameters) -> Parameters:
    """Second set less reference, of the numbers that both have; no deviation unless both have."""
    made = {}
    for name in [name for name in against if name in reference]:
        other, one = against[name], reference[name]
        determined = one.std is not None and other.std is not None
        std = float(np.hypot(one.std or 0.0, other.std or 0.0)) if determined else None
        made[name] = EffectParameter(other.value - one.value, std, other.unit)
    return made


def _side_of(sets: TwoSets, term: Term) -> str:
    """The set whose recordings a term acts in: ``reference`` or ``against``."""
    return "against" if term.candidate.scope <= sets.second else "reference"


def _torques_of(
    sets: TwoSets, terms: Sequence[Term], recordings: Scope | None = None
) -> tuple[JointTorque, ...]:
    """RMS of their torque in the recordings where they act, at joints where it matters."""
    data, joint = sets.data, terms[0].key.joint
    inside = recordings or frozenset().union(*(t.candidate.scope for t in terms))
    first = None if joint is None else data.joints[joint]
    sizes = zip(data.joints, rms_of(data, terms, inside), sets.sizes, strict=True)
    made = [
        JointTorque(name, float(rms), float(rms / size))
        for joint, (name, rms, size) in enumerate(sizes)
        if joint not in sets.not_compared
        and (name == first or rms >= settings.LEAST_NONPARAMETRIC * size)
    ]
    return tuple(sorted(made, key=lambda one: (one.joint != first, -one.share_of_torque)))


def _no_difference(
    data: Baseline,
    named: str,
    joints: Sequence[JointContrast],
    of_reference: Sequence[float],
    least: FloatArray,
) -> str:
    """That the sets do not differ, and where more is left of the second one than of the reference.

    `of_reference`, `least` (joints,): what is left in the reference, rms, and how much more counts.
    """
    if not joints:
        return "Nothing could be compared."
    where = "" if len(joints) == len(data.joints) else f" at {', '.join(j.joint for j in joints)}"
    worst = max(joints, key=lambda joint: joint.after)
    text = (
        f"No difference{where}: parts of {named} are predicted as well by the numbers of all "
        "recordings as by numbers of their own, fitted to the other parts "
        f"({torque(data, worst.after, worst.joint)} rms at {worst.joint} are left either way)."
    )
    more = ", ".join(
        f"at {joint.joint} {torque(data, joint.after, joint.joint)} rms against "
        f"{torque(data, left, joint.joint)}"
        for joint, left, size in zip(joints, of_reference, least, strict=True)
        if joint.after**2 - left**2 >= size**2
    )
    if more:
        text += (
            f" But more is left of {named} than of the reference, {more}: noise, or an effect that "
            "is not in the catalogue."
        )
    return text


def _shift(shifts: Mapping[str, EffectParameter]) -> str:
    """The effort's shift in both sets, which is taken out."""
    said = [
        f"{round(1e3 * shift.value, 2) + 0.0:.2f} ± {1e3 * settings.NORMAL_95 * shift.std:.2g} ms"
        for shift in shifts.values()
        if shift.std is not None
    ]
    if len(said) < len(shifts):
        return "the effort's shift in time cannot be compared: it cannot be determined in each set"
    return (
        f"the effort acts {said[0]} after its stamp in the reference recordings, {said[1]} in the "
        "second set: each was aligned by its own, since a command that is held over its period "
        "makes half a period"
    )


def _in_words(data: Baseline, term: Term) -> str:
    """An effect and its joint."""
    effect, place = term.candidate.effect, term.candidate.place
    joint = None if place is None else data.joints[place.joint]
    if isinstance(effect, Nonparametric):
        return f"{sentences.placed('a torque', joint, 'at')} that {effect.words}"
    return sentences.placed(effect.name, joint, "at")


def _joints(sets: TwoSets, changes: Changes) -> tuple[list[JointContrast], list[float]]:
    """RMS in the second set of three models, and of the whole one in the reference.

    The three: that of the reference, with the causes, and with numbers of the second set alone, in
    each part of the time as the other parts have them. What is left in the reference is that of
    white noise at the second set's rate.
    """
    data, model = sets.data, changes.selection.model
    after = model.residuals
    before = [rest.copy() for rest in after]
    for term in model.terms:
        if not term.candidate.scope:
            continue
        columns: Columns = term.columns
        sign = 1.0
        if _side_of(sets, term) == "reference":  # an effect or a curve: numbers are the second's
            (columns,), sign = rows_of(data, term.effect, term.place, [term.shape]), -1.0
        for joint, rows in columns.items():
            moved = sign * (rows @ term.coefficients) * sets.inside[joint]
            before[joint] += moved
            if term in changes.doubtful:
                after[joint] += moved
    ledger = changes.selection.comparison.options.ledger
    part, alone = quarters(data, ledger), [rest.copy() for rest in after]
    for number in np.unique(part):
        out = [part[blocks] == number for blocks in ledger.blocks]
        fitted = [inside & ~gone for inside, gone in zip(sets.inside, out, strict=True)]
        left = refit_residuals(ledger, after, fitted)
        for rest, predicted, gone in zip(alone, left, out, strict=True):
            rest[gone] = predicted[gone]
    one, other = (
        min(motion.signals.rate for motion in refit.data.prepared.motions) for refit in sets.refits
    )
    noise = float(np.sqrt(max(1.0, one / other)))  # fewer samples in a row: more noise
    made, of_reference = [], []
    for joint, (name, inside) in enumerate(zip(data.joints, sets.inside, strict=True)):
        if joint in sets.not_compared:
            continue
        first, second, least = (rms(rest[joint][inside]) for rest in (before, after, alone))
        least = min(least, second)
        share = float(np.sqrt(max(first**2 - least**2, 0.0)) / sets.sizes[joint])
        unexplained = float(np.sqrt(second**2 - least**2))
        made.append(JointContrast(name, first, second, least, share, unexplained))
        of_reference.append(noise * rms(after[joint][~inside]))
    return made, of_reference
