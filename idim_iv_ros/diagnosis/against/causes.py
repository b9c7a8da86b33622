"""What changed from a reference set of recordings to a second one, cause by cause and in words."""

from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.against.changes import Changes, NumberChange, rms_of
from idim_iv_ros.diagnosis.against.sets import TwoSets
from idim_iv_ros.diagnosis.answer.causes import rivals_of
from idim_iv_ros.diagnosis.comparison.model_with_terms import Term
from idim_iv_ros.diagnosis.controller import law_change, shown_law, why_not_checked
from idim_iv_ros.diagnosis.refit.command_rows import CommandRows
from idim_iv_ros.diagnosis.result.causes import Evidence
from idim_iv_ros.diagnosis.result.recordings import ContrastCause, JointTorque
from idim_iv_ros.diagnosis.sentences import listed_numbers, or_else, spaced, torque, with_interval
from idim_iv_ros.effects.cause import EffectParameter, Parameters
from idim_iv_ros.effects.registry import BY_NAME, CONTROL_LAW, name_of
from idim_iv_ros.simulation import ControlLaw

WHERE = {"reference": "in the reference recordings only", "against": "in the second set only"}


def side_of(sets: TwoSets, term: Term) -> str:
    """The set whose recordings a term acts in: ``reference`` or ``against``."""
    return "against" if (term.candidate.scope or sets.first) <= sets.second else "reference"


def torques_of(
    sets: TwoSets, terms: Sequence[Term], recordings: frozenset[int] | None = None
) -> tuple[JointTorque, ...]:
    """RMS of their torque in the recordings where they act, at joints where it matters."""
    data, place = sets.data, terms[0].candidate.place
    inside = recordings or frozenset().union(*(t.candidate.scope for t in terms))
    first = None if place is None else data.joints[place.joint]
    sizes = zip(data.joints, rms_of(data, terms, inside), sets.sizes, strict=True)
    made = [
        JointTorque(name, float(rms), float(rms / size))
        for joint, (name, rms, size) in enumerate(sizes)
        if joint not in sets.not_compared
        and (name == first or rms >= settings.LEAST_NONPARAMETRIC * size)
    ]
    return tuple(sorted(made, key=lambda one: (one.joint != first, -one.share_of_torque)))


def structural_causes(sets: TwoSets, changes: Changes) -> list[ContrastCause]:
    """One cause of every effect that one set has, or that the sets have otherwise."""
    data, space, made = sets.data, changes.selection.catalogue.space, []
    places: dict[tuple[str, int | None, int | None], dict[str, Term]] = {}
    for term in changes.accepted:
        if term.is_effect:
            places.setdefault(term.key[:3], {})[side_of(sets, term)] = term
    for place, sides in sorted(places.items(), key=lambda item: item[0]):
        terms = list(sides.values())
        one, other = (
            data.in_units_at(term.place.joint, term.parameters(space)) if term else {}
            for term in map(sides.get, WHERE)
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
            text += f" {WHERE['reference' if one else 'against']}: {said or said_other}"
        fields: dict[str, Any] = {"numbers": (one, other), "change": change, "joint": joints[0]}
        if len(joints) > 1:
            fields["other_joint"] = joints[1]
        made.append(_of_terms(sets, changes, terms, text, **fields))
    return made


def parametric_causes(
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


def _of_terms(
    sets: TwoSets,
    changes: Changes,
    terms: Sequence[Term],
    text: str,
    recordings: frozenset[int] | None = None,
    **fields: Any,
) -> ContrastCause:
    """A cause that terms of the search are; `text`: what changed, without its torques."""
    torques = torques_of(sets, terms, recordings)
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
        sentence=f"{text}{listed and f'; that is {listed}'}{or_else(others)}",
        **fields,
    )


def _cause(
    sets: TwoSets,
    effect: str,
    numbers: tuple[Parameters, Parameters] = ({}, {}),
    **fields: Any,
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


def law_causes(sets: TwoSets, without: Collection[str]) -> tuple[list[ContrastCause], str]:
    """Compare the law that each set shows; and why not, where they cannot be compared.

    The configured law is only the form: what both sets have otherwise than configured cancels.
    """
    if CONTROL_LAW.name in without:
        return [], ""
    for refit, name in zip(sets.refits, ("reference", "second set"), strict=True):
        reason = why_not_checked(refit.data)
        if reason:
            return [], f"the control laws of the sets were not compared: {reason} ({name})"
    (commands, _, one), (_, _, other) = (shown_law(refit.data) for refit in sets.refits)
    causes = []
    for joint in sorted(set(one) & set(other) - set(sets.not_compared)):
        rows = one[joint].every.followed_by(other[joint].every)
        causes += _law_cause(sets, commands.law, joint, rows)
    return causes, ""


def _law_cause(
    sets: TwoSets, law: ControlLaw, joint: int, rows: CommandRows
) -> list[ContrastCause]:
    """What one joint is controlled by otherwise in the second set; none where in nothing."""
    change = law_change(rows)
    differing = [term for term in change.terms if term.key.scope]
    if not differing:
        return []
    groups: tuple[dict[str, tuple[float, float]], ...] = {}, {}
    command = np.zeros(len(rows.rest))
    for term in differing:
        name, value = term.key.effect, float(term.coefficients[0])
        common, std = change.changes.get(name, (0.0, 0.0))
        groups[0][name] = common, std
        groups[1][name] = common + value, float(np.hypot(std, term.deviations[0]))
        command += value * rows.groups[name]
    reference, against = (
        sets.data.in_units_at(joint, CONTROL_LAW.parameters(law, joint, group)) for group in groups
    )
    # What the change makes on the second set's motion.
    rms = float(np.std(command[rows.second]))
    made = JointTorque(sets.data.joints[joint], rms, rms / float(sets.sizes[joint]))
    changed = ", ".join(
        f"{spaced(name)} from {with_interval(reference[name])} to {with_interval(number)}"
        for name, number in against.items()
    )
    sentence = (
        f"control law of {made.joint} changed: {changed} "
        f"({100.0 * made.share_of_torque:.3g} % of its torque)"
    )
    said = {"joint": made.joint, "sentence": sentence, "torques": (made,)}
    evidence = Evidence(2.0 * sum(term.evidence for term in differing))
    return [_cause(sets, CONTROL_LAW.name, (reference, against), evidence=evidence, **said)]


def scaled_alike(law: ContrastCause, numbers: Sequence[ContrastCause]) -> bool:
    """Whether the torque gain of a joint explains its change of law.

    A gain of what is recorded changes all commands by its inverse: then both are one cause.
    """
    for cause in numbers:
        factor = cause.parameters.get("factor")
        if factor is None or cause.joint != law.joint or cause.kind != "parametric":
            continue
        if BY_NAME[cause.effect].part == "torque scale":
            return bool(law.against) and all(
                abs(factor.value * other.value - law.reference[name].value)
                < settings.NORMAL_95
                * np.hypot(factor.value * (other.std or 0.0), (factor.std or 0.0) * other.value)
                for name, other in law.against.items()
            )
    return False


def delay_causes(sets: TwoSets, shifts: Mapping[str, EffectParameter]) -> list[ContrastCause]:
    """A shift of the effort that changed by more than recording makes of it."""
    numbers = {"delay": shifts["reference"]}, {"delay": shifts["against"]}
    delay = _difference(numbers[1], numbers[0])["delay"]
    period = max(refit.shift.period for refit in sets.refits)
    if delay.std is None or abs(delay.value) < max(
        settings.CONTRAST_LEAST_DELAY * period, settings.CLEAR_DEVIATIONS * delay.std
    ):
        return []
    sentence = (
        f"the effort acts {1e3 * abs(delay.value):.2f} ± "
        f"{1e3 * settings.NORMAL_95 * delay.std:.2g} ms "
        f"{'later' if delay.value > 0.0 else 'earlier'} in the second set, at all joints"
    )
    evidence = Evidence((delay.value / delay.std) ** 2)
    return [_cause(sets, name_of("delay"), numbers, evidence=evidence, sentence=sentence)]


def _difference(
    against: Mapping[str, EffectParameter], reference: Mapping[str, EffectParameter]
) -> Parameters:
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
