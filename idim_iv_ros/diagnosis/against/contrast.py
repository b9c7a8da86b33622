"""What changed between two sets of recordings: the whole of `diagnose --against`."""

from collections.abc import Collection, Mapping, Sequence

import numpy as np

from idim_iv_ros.configuration import Configuration
from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.against.causes import (
    WHERE,
    delay_causes,
    law_causes,
    parametric_causes,
    scaled_alike,
    side_of,
    structural_causes,
    torques_of,
)
from idim_iv_ros.diagnosis.against.changes import (
    Changes,
    changes_between,
    number_changes,
    quarters,
)
from idim_iv_ros.diagnosis.against.sets import TwoSets, two_sets
from idim_iv_ros.diagnosis.comparison.candidate import Catalogue, Kind
from idim_iv_ros.diagnosis.comparison.curves import Nonparametric
from idim_iv_ros.diagnosis.comparison.model_with_terms import Term
from idim_iv_ros.diagnosis.comparison.select import refit_residuals
from idim_iv_ros.diagnosis.likelihood import Columns, rms
from idim_iv_ros.diagnosis.refit.baseline import Baseline, rows_of
from idim_iv_ros.diagnosis.result.recordings import ContrastResult, JointContrast
from idim_iv_ros.diagnosis.sentences import capitalised, placed, torque
from idim_iv_ros.effects.cause import EffectParameter
from idim_iv_ros.recording.recording import Recording
from idim_iv_ros.types import FloatArray


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
    data, against = sets.data, sets.bags(sets.second)
    numbers = number_changes(changes)
    law, why_no_law = law_causes(sets, without)
    shifts = {name: refit.shift.common for name, refit in zip(WHERE, sets.refits, strict=True)}
    delay = delay_causes(sets, shifts)
    parametric = parametric_causes(sets, changes, numbers)
    law = [cause for cause in law if not scaled_alike(cause, parametric)]
    causes = [*structural_causes(sets, changes), *parametric, *law, *delay]
    causes.sort(key=lambda cause: -max((t.share_of_torque for t in cause.torques), default=0.0))
    unattributed = tuple(
        _unattributed(sets, term) for term in changes.accepted if term.candidate.kind is Kind.CURVE
    )
    joints, of_reference = _joints(sets, changes)
    compared = [joint for joint in range(len(data.joints)) if joint not in sets.not_compared]
    least = settings.LEAST_NONPARAMETRIC * sets.sizes[compared]
    unexplained = [one for one, size in zip(joints, least, strict=True) if one.unexplained >= size]
    names = data.joints
    not_compared = tuple(
        f"{names[n]} is not compared: {why}" for n, why in sets.not_compared.items()
    )
    differs = bool(causes or unattributed or unexplained) or (None if not_compared else False)
    if differs:
        said = (*(cause.sentence for cause in causes), *unattributed)
        closest = [f"{_in_words(data, t)} (in {n})" for t, n in changes.doubtful.items() if n]
        sentence = _changes(data, against, said, unexplained, closest)
    else:
        noisier = {
            joint.joint: level
            for joint, level, size in zip(joints, of_reference, least, strict=True)
            if joint.after**2 - level**2 >= size**2
        }
        sentence = _no_difference(data, against, joints, noisier)
    groups = sorted(sets.bags(group) for group in {change.recordings for change in numbers})
    notes = [
        "" if delay else _shift(shifts),
        *(
            f"{name}: {refit.turning.sentence(data.joints)}"
            for name, refit in zip(("the reference", "the second set"), sets.refits, strict=True)
            if refit.turning.soft
        ),
        "the recordings of the second set do not agree and were compared apart: "
        f"{'; '.join(', '.join(group) for group in groups)}"
        if len(groups) > 1
        else "",
        why_no_law,
    ]
    named = (Kind.EFFECT, Kind.CURVE)
    return ContrastResult(
        reference=sets.bags(sets.first),
        against=against,
        differs=differs,
        sentence=" ".join([sentence, *(f"{capitalised(text)}." for text in not_compared)]),
        not_compared=not_compared,
        joints=tuple(joints),
        causes=tuple(causes),
        unattributed=unattributed,
        common=tuple(_in_words(data, t) for t in changes.common if t.candidate.kind in named),
        effort_shift=shifts,
        notes=tuple(note for note in notes if note),
    )


def _no_difference(
    data: Baseline,
    against: Sequence[str],
    joints: Sequence[JointContrast],
    noisier: Mapping[str, float],
) -> str:
    """That the sets do not differ, and where more is left of the second one.

    `noisier`: what is left in the reference, rms, where that is less than in the second set.
    """
    if not joints:
        return "Nothing could be compared."
    named = ", ".join(against)
    where = "" if len(joints) == len(data.joints) else f" at {', '.join(j.joint for j in joints)}"
    worst = max(joints, key=lambda joint: joint.after)
    text = (
        f"No difference{where}: parts of {named} are predicted as well by the numbers of all "
        "recordings as by numbers of their own, fitted to the other parts "
        f"({torque(data, worst.after, worst.joint)} rms at {worst.joint} are left either way)."
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


def _changes(
    data: Baseline,
    against: Sequence[str],
    said: Sequence[str],
    unexplained: Sequence[JointContrast],
    closest: Sequence[str],
) -> str:
    """In what the sets differ, what is not explained, and what comes closest to explaining it."""
    parts = [f"What changed from the reference recordings to {', '.join(against)}:"]
    parts += [f"{capitalised(text)}." for text in said]
    left = ", ".join(
        f"at {joint.joint} by {torque(data, joint.unexplained, joint.joint)}"
        for joint in unexplained
    )
    if left:
        nothing = "nothing else" if said else "nothing"
        parts.append(f"The recordings differ {left}; {nothing} in the catalogue explains it.")
    if left and closest:
        parts.append(
            f"Closest comes {', '.join(closest)}, which is not chosen again whenever a part of the "
            "time is left out."
        )
    return " ".join(parts)


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


def _unattributed(sets: TwoSets, term: Term) -> str:
    """A difference outside the catalogue."""
    effect, made = term.candidate.effect, torques_of(sets, [term])[0]
    assert isinstance(effect, Nonparametric)
    return (
        f"the recordings differ at {made.joint} by {torque(sets.data, made.rms, made.joint)}, a "
        f"torque that {effect.words}, {WHERE[side_of(sets, term)]}; nothing in the catalogue "
        "explains it"
    )


def _in_words(data: Baseline, term: Term) -> str:
    """An effect and its joint."""
    effect, place = term.candidate.effect, term.candidate.place
    joint = None if place is None else data.joints[place.joint]
    if isinstance(effect, Nonparametric):
        return f"{placed('a torque', joint, 'at')} that {effect.words}"
    return placed(effect.name, joint, "at")


def _joints(sets: TwoSets, changes: Changes) -> tuple[list[JointContrast], list[float]]:
    """RMS in the second set of three models, and of the whole one in the reference.

    The three: that of the reference, with the causes, and with numbers of the second set alone, in
    each part of the time as the other parts have them. What is left in the reference is that of
    white noise at the second set's rate.
    """
    model = changes.selection.model
    after = model.residuals
    before = [rest.copy() for rest in after]
    for term in model.terms:
        for joint, moved in _moved(sets, term).items():
            before[joint] += moved
            if term in changes.doubtful:
                after[joint] += moved
    alone = _with_numbers_of_second(sets, changes, after)
    one, other = (
        min(motion.signals.rate for motion in refit.data.prepared.motions) for refit in sets.refits
    )
    noise = float(np.sqrt(max(1.0, one / other)))  # fewer samples in a row: more noise
    made, of_reference = [], []
    for joint, (name, inside) in enumerate(zip(sets.data.joints, sets.inside, strict=True)):
        if joint in sets.not_compared:
            continue
        first, second, least = (rms(rest[joint][inside]) for rest in (before, after, alone))
        least = min(least, second)
        share = float(np.sqrt(max(first**2 - least**2, 0.0)) / sets.sizes[joint])
        unexplained = float(np.sqrt(second**2 - least**2))
        made.append(JointContrast(name, first, second, least, share, unexplained))
        of_reference.append(noise * rms(after[joint][~inside]))
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
        for rest, predicted, gone in zip(made, left, out, strict=True):
            rest[gone] = predicted[gone]
    return made


def _moved(sets: TwoSets, term: Term) -> dict[int, FloatArray]:
    """What the second set's torque (r_j,) has beyond the reference's model by a term."""
    columns: Columns = term.columns
    sign = 1.0
    if not term.candidate.scope:
        return {}
    if side_of(sets, term) == "reference":
        if term.candidate.kind is Kind.NUMBER:
            return {}
        (columns,) = rows_of(sets.data, term.effect, term.place, [term.shape])
        sign = -1.0
    return {
        joint: sign * (rows @ term.coefficients) * sets.inside[joint]
        for joint, rows in columns.items()
    }
