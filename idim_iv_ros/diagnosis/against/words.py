"""Sentences about what changed between two sets of recordings, made from values."""

from collections.abc import Mapping, Sequence

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.comparison.curves import Nonparametric
from idim_iv_ros.diagnosis.comparison.model_with_terms import Term
from idim_iv_ros.diagnosis.refit.baseline import Baseline
from idim_iv_ros.diagnosis.refit.soft_friction import SoftFriction
from idim_iv_ros.diagnosis.result import (
    ContrastCause,
    EffectParameter,
    JointContrast,
    JointTorque,
)
from idim_iv_ros.diagnosis.sentences import (
    capitalised,
    listed_numbers,
    or_else,
    spaced,
    torque,
    with_interval,
)

_WHERE = {"reference": "in the reference recordings only", "against": "in the second set only"}


def no_difference(
    data: Baseline,
    against: Sequence[str],
    joints: Sequence[JointContrast],
    noisier: Mapping[str, float],
) -> str:
    """That the sets do not differ, and where more is left of the second one.

    Parameters
    ----------
    noisier
        What is left in the reference, rms, at joints where that is less than in the second set.
    """
    named = ", ".join(against)
    worst = max(joints, key=lambda joint: joint.after)
    left = torque(data, worst.after, worst.joint)
    text = (
        f"No difference: parts of {named} are predicted as well by the numbers of all recordings "
        f"as by numbers of their own, fitted to the other parts ({left} rms at {worst.joint} are "
        "left either way)."
    )
    more = ", ".join(
        f"at {joint.joint} {torque(data, joint.after, joint.joint)} rms against "
        f"{torque(data, noisier[joint.joint], joint.joint)}"
        for joint in joints
        if joint.joint in noisier
    )
    if more:
        text += (
            f" But more is left of {named} than of the reference, {more}: noise, or an effect that "
            "is not in the catalogue."
        )
    return text


def changes(
    data: Baseline,
    against: Sequence[str],
    causes: Sequence[ContrastCause],
    unattributed: Sequence[str],
    unexplained: Sequence[JointContrast],
    closest: Sequence[tuple[Term, str]],
) -> str:
    """In what the sets differ, and what is not explained.

    Parameters
    ----------
    closest
        Changes that were not confirmed, and in how many parts of the time they are chosen.
    """
    parts = [f"What changed from the reference recordings to {', '.join(against)}:"]
    parts += [f"{capitalised(text)}." for text in (*(c.sentence for c in causes), *unattributed)]
    left = ", ".join(
        f"at {joint.joint} by {torque(data, joint.unexplained, joint.joint)}"
        for joint in unexplained
    )
    if left:
        nothing = "nothing else" if causes or unattributed else "nothing"
        parts.append(f"The recordings differ {left}; {nothing} in the catalogue explains it.")
    if left and closest:
        listed = ", ".join(f"{common(data, term)} (in {times})" for term, times in closest)
        parts.append(
            f"Closest comes {listed}, which is not chosen again whenever a part of the time is "
            "left out."
        )
    return " ".join(parts)


def structural(data: Baseline, cause: ContrastCause) -> str:
    """An effect that one set has, or that the sets have otherwise, with its numbers in each."""
    where = cause.joint if cause.other_joint is None else f"{cause.joint} and {cause.other_joint}"
    effect = f"{spaced(cause.effect)} at {where}"
    one, other = (
        listed_numbers(cause.effect, numbers) for numbers in (cause.reference, cause.against)
    )
    if cause.change == "changed" and one and other:
        text = f"{effect} changed: {one} in the reference, {other} in the second set"
    elif cause.change == "changed":
        more = "reference recordings" if one else "second set"
        text = f"{effect} changed: more of it in the {more} ({one or other})"
    else:
        text = f"{effect} {_WHERE['reference' if one else 'against']}: {one or other}"
    return f"{text}{_torques(data, cause.torques)}{or_else(cause.indistinguishable_from)}"


def parametric(data: Baseline, cause: ContrastCause, which: str, *, several: bool) -> str:
    """Numbers that changed, as second set less reference.

    Parameters
    ----------
    which
        More words for its joint.
    several
        Whether not all recordings of the second set have these.
    """
    place = "" if cause.joint is None else f" of {cause.joint}{which}"
    return (
        f"{', '.join(cause.bags) + ': ' if several else ''}{spaced(cause.effect)}{place} changed, "
        f"second set less reference: {listed_numbers(cause.effect, cause.parameters)}"
        f"{_torques(data, cause.torques)}{or_else(cause.indistinguishable_from)}"
    )


def law(cause: ContrastCause) -> str:
    """Gains and feedforward that changed."""
    changed = ", ".join(
        f"{spaced(name)} from {with_interval(cause.reference[name])} to {with_interval(number)}"
        for name, number in cause.against.items()
    )
    share = 100.0 * cause.torques[0].share_of_torque
    return f"control law of {cause.joint} changed: {changed} ({share:.3g} % of its torque)"


def delay(change: EffectParameter) -> str:
    """A time from the effort to the torque, s, that changed for all joints."""
    half = settings.NORMAL_95 * (change.std or 0.0)
    later = "later" if change.value > 0.0 else "earlier"
    return (
        f"the effort acts {1e3 * abs(change.value):.2f} ± {1e3 * half:.2g} ms {later} in the "
        "second set, at all joints"
    )


def shift(shifts: Mapping[str, EffectParameter]) -> str:
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


def softened(frictions: Sequence[SoftFriction | None], joints: Sequence[str]) -> list[str]:
    """Dry friction that the solver of a simulator softens, of each set that has it."""
    names = ("the reference", "the second set")
    return [
        f"{name}: {friction.sentence(joints)}"
        for name, friction in zip(names, frictions, strict=True)
        if friction is not None
    ]


def groups(groups: Sequence[Sequence[str]]) -> str:
    """Recordings of the second set that do not agree; empty where all do."""
    if len(groups) < 2:
        return ""
    listed = "; ".join(", ".join(group) for group in groups)
    return f"the recordings of the second set do not agree and were compared apart: {listed}"


def reference_disagrees(bags: Sequence[str]) -> str:
    """Recordings of the reference that differ from its others; empty where none does."""
    if not bags:
        return ""
    return (
        f"the reference recordings do not agree among themselves ({', '.join(bags)}): changes are "
        "those from their mean; give the recordings that agree"
    )


def unattributed(data: Baseline, term: Term, side: str, made: JointTorque) -> str:
    """A difference outside the catalogue."""
    effect = term.candidate.effect
    assert isinstance(effect, Nonparametric)
    return (
        f"the recordings differ at {made.joint} by {torque(data, made.rms, made.joint)}, a torque "
        f"that {effect.words}, {_WHERE[side]}; nothing in the catalogue explains it"
    )


def common(data: Baseline, term: Term) -> str:
    """An effect and its joint, as one that both sets share."""
    effect, place = term.candidate.effect, term.candidate.place
    where = "" if place is None else f" at {data.joints[place.joint]}"
    if isinstance(effect, Nonparametric):
        return f"a torque{where} that {effect.words}"
    return f"{spaced(effect.name)}{where}"


def _torques(data: Baseline, torques: Sequence[JointTorque]) -> str:
    listed = ", ".join(
        f"{torque(data, made.rms, made.joint)} at {made.joint} "
        f"({100.0 * made.share_of_torque:.3g} % of its torque)"
        for made in torques
    )
    return listed and f"; that is {listed}"
