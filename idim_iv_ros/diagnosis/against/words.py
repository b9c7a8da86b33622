"""Sentences about what changed between two sets of recordings, made from values."""

from collections.abc import Mapping, Sequence

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.against.law import ShiftDifference
from idim_iv_ros.diagnosis.comparison.beside import Term
from idim_iv_ros.diagnosis.parameter_words import parameter_words, surest
from idim_iv_ros.diagnosis.refit.baseline import Baseline
from idim_iv_ros.diagnosis.refit.soft_friction import SoftFriction
from idim_iv_ros.diagnosis.result import (
    ContrastCause,
    EffectParameter,
    Indistinguishable,
    JointContrast,
    JointTorque,
)
from idim_iv_ros.diagnosis.sentences import capitalised
from idim_iv_ros.diagnosis.structural.nonparametric import Nonparametric
from idim_iv_ros.effects.effect import Place
from idim_iv_ros.effects.parametric_effect import ParametricEffect

_WHERE = {"reference": "in the reference recordings only", "against": "in the second set only"}


def summary(
    data: Baseline,
    against: Sequence[str],
    causes: Sequence[ContrastCause],
    unattributed: Sequence[str],
    unexplained: Sequence[JointContrast],
    joints: Sequence[JointContrast],
    *,
    differs: bool,
) -> str:
    """The answer: whether the sets differ, in what, and what is not explained."""
    named = ", ".join(against)
    if not differs:
        worst = max(joints, key=lambda each: each.own)
        unit = data.unit_at(data.joints.index(worst.joint), "N m")
        return (
            f"No difference: one model holds for the reference recordings and for {named}. A model "
            f"of their own predicts {named} no better than chance allows ({worst.own:.3g} {unit} "
            f"rms at {worst.joint} are left either way)."
        )
    parts = [f"What changed from the reference recordings to {named}:"]
    parts += [f"{capitalised(cause.sentence)}." for cause in causes]
    parts += [f"{capitalised(each)}." for each in unattributed]
    left = ", ".join(_left(data, each) for each in unexplained)
    if left:
        nothing = "nothing else" if causes or unattributed else "nothing"
        parts.append(f"The recordings differ {left}; {nothing} in the catalogue explains it.")
    elif not causes and not unattributed:
        worst = max(joints, key=lambda each: each.share_of_torque)
        parts.append(
            f"The recordings differ at {worst.joint} by "
            f"{100.0 * worst.share_of_torque:.2g} % of its torque; nothing in the catalogue "
            "explains it."
        )
    return " ".join(parts)


def _left(data: Baseline, each: JointContrast) -> str:
    unit = data.unit_at(data.joints.index(each.joint), "N m")
    return f"at {each.joint} by {each.unexplained:.3g} {unit}"


def structural(
    data: Baseline,
    name: str,
    place: Place,
    change: str,
    numbers: Mapping[str, dict[str, EffectParameter]],
    torques: Sequence[JointTorque],
    others: Sequence[Indistinguishable],
) -> str:
    """An effect that one set has, or that the sets have otherwise."""
    where = data.joints[place.joint]
    if place.other is not None:
        where += f" and {data.joints[place.other]}"
    effect = spaced(name)
    one, other = (_numbers(name, numbers[each]) for each in ("reference", "against"))
    if change == "changed" and one and other:
        what = f"{effect} at {where} changed: {one} in the reference, {other} in the second set"
    elif change == "changed":
        more = "reference recordings" if one else "second set"
        what = f"{effect} at {where} changed: more of it in the {more} ({one or other})"
    else:
        what = f"{effect} at {where} {_WHERE['reference' if one else 'against']}: {one or other}"
    return f"{what}{_torques(data, torques)}{_indistinguishable(others)}"


def parametric(
    data: Baseline,
    effect: ParametricEffect,
    joint: int | None,
    parameters: dict[str, EffectParameter],
    torques: Sequence[JointTorque],
    others: Sequence[Indistinguishable],
    bags: Sequence[str],
) -> str:
    """Numbers that changed, as second set less reference."""
    place = "" if joint is None else f" of {data.joints[joint]}{effect.which(joint)}"
    text = (
        f"{spaced(effect.name)}{place} changed, second set less reference: "
        f"{_numbers(effect.name, parameters)}"
    )
    if bags:
        text = f"{', '.join(bags)}: {text}"
    return f"{text}{_torques(data, torques)}{_indistinguishable(others)}"


def law(
    joint: str,
    reference: dict[str, EffectParameter],
    against: dict[str, EffectParameter],
    torque: JointTorque,
) -> str:
    """Gains and feedforward that changed."""
    changed = ", ".join(
        f"{spaced(name)} from {_value(reference[name])} to {_value(each)}"
        for name, each in against.items()
    )
    return (
        f"control law of {joint} changed: {changed} "
        f"({100.0 * torque.share_of_torque:.2g} % of its torque)"
    )


def delay(difference: ShiftDifference) -> str:
    """A time from the effort to the torque that changed for all joints."""
    change = difference.change
    half = settings.NORMAL_95 * (change.std or 0.0)
    later = "later" if change.value > 0.0 else "earlier"
    return (
        f"the effort acts {1e3 * abs(change.value):.2f} ± {1e3 * half:.2g} ms {later} in the "
        "second set, at all joints"
    )


def shift(difference: ShiftDifference) -> str:
    """The effort's shift in both sets, which is taken out; empty where it is a cause."""
    if difference.is_delay:
        return ""
    one, other = difference.reference, difference.against
    if one.std is None or other.std is None:
        return "the effort's shift in time cannot be compared: it cannot be determined in each set"
    first, second = (
        f"{round(1e3 * value, 2) + 0.0:.2f} ± {1e3 * settings.NORMAL_95 * std:.2g} ms"
        for value, std in ((one.value, one.std), (other.value, other.std))
    )
    return (
        f"the effort acts {first} after its stamp in the reference recordings, {second} in the "
        "second set: each was aligned by its own, since a command that is held over its period "
        "makes half a period"
    )


def softened(found: Sequence[SoftFriction | None], joints: Sequence[str]) -> list[str]:
    """Dry friction that the solver of a simulator softens, of each set that has it."""
    names = ("the reference", "the second set")
    return [
        f"{name}: {each.sentence(joints)}"
        for name, each in zip(names, found, strict=True)
        if each is not None
    ]


def groups(groups: Sequence[Sequence[str]]) -> str:
    """Recordings of the second set that do not agree; empty where all do."""
    if len(groups) < 2:
        return ""
    listed = "; ".join(", ".join(each) for each in groups)
    return f"the recordings of the second set do not agree and were compared apart: {listed}"


def reference_disagrees(bags: Sequence[str]) -> str:
    """Recordings of the reference that differ from its others; empty where none does."""
    if not bags:
        return ""
    return (
        f"the reference recordings do not agree among themselves ({', '.join(bags)}): changes are "
        "those from their mean; give the recordings that agree"
    )


def unattributed(data: Baseline, term: Term, scope: str, torque: JointTorque) -> str:
    """A difference outside the catalogue."""
    effect = term.candidate.effect
    assert isinstance(effect, Nonparametric)
    unit = data.unit_at(data.joints.index(torque.joint), "N m")
    return (
        f"the recordings differ at {torque.joint} by {torque.rms:.3g} {unit}, a torque that "
        f"{effect.words}, {_WHERE[scope]}; nothing in the catalogue explains it"
    )


def common(data: Baseline, term: Term) -> str:
    """An effect that both sets share."""
    effect, place = term.candidate.effect, term.candidate.place
    assert place is not None
    joint = data.joints[place.joint]
    if isinstance(effect, Nonparametric):
        return f"a torque at {joint} that {effect.words}"
    return f"{spaced(effect.name)} at {joint}"


def spaced(name: str) -> str:
    """Return a name of the catalogue in words."""
    return name.replace("_", " ")


def _torques(data: Baseline, torques: Sequence[JointTorque]) -> str:
    listed = ", ".join(
        f"{each.rms:.3g} {data.unit_at(data.joints.index(each.joint), 'N m')} at {each.joint} "
        f"({100.0 * each.share_of_torque:.2g} % of its torque)"
        for each in torques
    )
    return listed and f"; that is {listed}"


def _indistinguishable(others: Sequence[Indistinguishable]) -> str:
    listed = ", ".join(
        spaced(each.effect) + (f" of {each.joint}" if each.joint else "") for each in others
    )
    return listed and f"; on these recordings it is indistinguishable from {listed}"


def _numbers(effect: str, parameters: Mapping[str, EffectParameter]) -> str:
    shown = surest(dict(parameters), settings.MOST_NUMBERS_IN_SENTENCE)
    return ", ".join(
        f"{parameter_words(effect, name)} {_value(each)}" for name, each in shown.items()
    )


def _value(parameter: EffectParameter) -> str:
    text = f"{parameter.value:.3g}"
    if parameter.std is not None:
        text += f" ± {settings.NORMAL_95 * parameter.std:.2g}"
    return f"{text} {parameter.unit}".rstrip()
