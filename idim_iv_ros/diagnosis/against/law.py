"""Changes of the control law and of the effort's shift between two sets of recordings."""

from collections.abc import Collection, Mapping
from dataclasses import replace

import numpy as np

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.against import words
from idim_iv_ros.diagnosis.against.sets import TwoSets
from idim_iv_ros.diagnosis.controller import law_change, shown_law, why_not_checked
from idim_iv_ros.diagnosis.refit.command_rows import CommandRows
from idim_iv_ros.diagnosis.result import ContrastCause, EffectParameter, Evidence, JointTorque
from idim_iv_ros.effects.registry import CONTROL_LAW, name_of
from idim_iv_ros.simulation import ControlLaw


def difference(
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
    one, other = (shown_law(refit.data) for refit in sets.refits)
    causes = [
        _cause(sets, one.law, joint, one.joints[joint][0].followed_by(other.joints[joint][0]))
        for joint in sorted(set(one.joints) & set(other.joints))
    ]
    return [cause for cause in causes if cause is not None], ""


def _cause(sets: TwoSets, law: ControlLaw, joint: int, rows: CommandRows) -> ContrastCause | None:
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
        parameters=difference(against, reference),
        reference=reference,
        against=against,
        evidence=Evidence(2.0 * sum(term.evidence for term in differing)),
        torques=(made,),
        sentence="",
    )
    return replace(cause, sentence=words.law(cause))


def effort_shifts(sets: TwoSets) -> dict[str, EffectParameter]:
    """Time from the recorded effort to the torque, common to all joints, s, of each set."""
    one, other = (EffectParameter(refit.shift.shift, refit.shift.std, "s") for refit in sets.refits)
    return {"reference": one, "against": other}


def delay_causes(sets: TwoSets) -> list[ContrastCause]:
    """A shift of the effort that changed by more than recording makes of it."""
    shifts = {name: {"delay": shift} for name, shift in effort_shifts(sets).items()}
    change = difference(shifts["against"], shifts["reference"])
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
        reference=shifts["reference"],
        against=shifts["against"],
        evidence=Evidence((delay.value / delay.std) ** 2),
        sentence=words.delay(delay),
    )
    return [cause]
