"""Changes of the control law and of the effort's shift between two sets of recordings."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.against.sets import TwoSets
from idim_iv_ros.diagnosis.controller.check import shown_law, why_not_checked
from idim_iv_ros.diagnosis.controller.law_change import CommandRows, law_change
from idim_iv_ros.effects.cause import EffectParameter
from idim_iv_ros.effects.registry import CONTROL_LAW
from idim_iv_ros.simulation import ControlLaw


@dataclass(frozen=True)
class LawDifference:
    """One joint that is controlled otherwise in the second set.

    Attributes
    ----------
    joint : int
    reference, against : dict of str to EffectParameter
        Gains and feedforward in each set, those that changed.
    statistic : float
        Twice the logarithm of the Bayes factor.
    torque : float
        RMS that the change makes on the second set's motion, N m (N).
    """

    joint: int
    reference: dict[str, EffectParameter]
    against: dict[str, EffectParameter]
    statistic: float
    torque: float

    @property
    def change(self) -> dict[str, EffectParameter]:
        """Second set less reference."""
        return less(self.against, self.reference)


def less(
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


def law_differences(
    sets: TwoSets, without: Collection[str]
) -> tuple[tuple[LawDifference, ...], str]:
    """Compare the law that each set shows; and why not, where they cannot be compared.

    The configured law is only the form: what both sets have otherwise than configured cancels.
    """
    if CONTROL_LAW.name in without:
        return (), ""
    for recordings, name in zip(sets.sets, ("reference", "second set"), strict=True):
        reason = why_not_checked(recordings)
        if reason:
            return (), f"the control laws of the sets were not compared: {reason} ({name})"
    one, other = (shown_law(each) for each in sets.sets)
    found = [
        _difference(one.law, joint, one.joints[joint][0].above(other.joints[joint][0]))
        for joint in sorted(set(one.joints) & set(other.joints))
    ]
    return tuple(each for each in found if each is not None), ""


def _difference(law: ControlLaw, joint: int, rows: CommandRows) -> LawDifference | None:
    change = law_change(rows)
    differing = [term for term in change.terms if term.key[3] is not None]
    if not differing:
        return None
    reference, against = {}, {}
    torque = np.zeros(len(rows.rest))
    for term in differing:
        name, value = term.key[0], float(term.coefficients[0])
        common, std = change.changes.get(name, (0.0, 0.0))
        reference[name] = common, std
        against[name] = common + value, float(np.hypot(std, term.deviations[0]))
        torque += value * rows.groups[name]
    one, other = (CONTROL_LAW.parameters(law, joint, side) for side in (reference, against))
    size = float(np.std(torque[rows.second]))
    return LawDifference(joint, one, other, 2.0 * sum(term.evidence for term in differing), size)


@dataclass(frozen=True)
class ShiftDifference:
    """How far the effort's shift changed, s; `is_delay`: by more than recording makes of it."""

    reference: EffectParameter
    against: EffectParameter
    is_delay: bool

    @property
    def change(self) -> EffectParameter:
        """Second set less reference; its deviation is None where one is not known."""
        return less({"delay": self.against}, {"delay": self.reference})["delay"]


def shift_difference(sets: TwoSets) -> ShiftDifference:
    """Compare the time from the recorded effort to the torque, common to all joints of each set."""
    one, other = (EffectParameter(shift.shift, shift.std, "s") for shift in sets.shifts)
    period = max(shift.period for shift in sets.shifts)
    found = ShiftDifference(one, other, is_delay=False)
    change = found.change
    late = (
        change.std is not None
        and abs(change.value) >= settings.CONTRAST_LEAST_DELAY * period
        and abs(change.value) >= settings.CLEAR_DEVIATIONS * change.std
    )
    return ShiftDifference(one, other, late)
