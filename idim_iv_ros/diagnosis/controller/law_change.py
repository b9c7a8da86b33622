"""The smallest change of the control law that explains one joint's commands."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.controller.command_regression import CommandRegression, rms
from idim_iv_ros.diagnosis.controller.law_event import beside_no_event
from idim_iv_ros.diagnosis.structural.likelihood import Fit
from idim_iv_ros.effects.controller_mismatch import GROUPS, LAG
from idim_iv_ros.simulation import ControlLaw
from idim_iv_ros.types import FloatArray


@dataclass(frozen=True)
class LawChange:
    """Groups of the law that differ at one joint.

    Attributes
    ----------
    rows : CommandRegression
        With a speed that is as late as the recording says.
    groups : tuple of str
        Empty where nothing differs.
    plain, fit : Fit
        Without and with the groups; both with a lag.
    """

    rows: CommandRegression
    groups: tuple[str, ...]
    plain: Fit
    fit: Fit

    @property
    def changes(self) -> dict[str, tuple[float, float]]:
        """(value, std) of the lag and of each group."""
        return self.rows.changes(self.fit, self.groups)

    def beyond(self, rows: CommandRegression) -> FloatArray:
        """What the commands of all rows (r,) hold beyond the law and its change, N m (N).

        Parameters
        ----------
        rows
            All of the joint, those beside events too.
        """
        if len(rows.rest) == len(self.rows.rest):
            return self.fit.residuals[0]
        rest = rows.rest.copy()
        for name, (value, _) in self.changes.items():
            rest -= value * (-rows.rate if name == LAG else rows.groups[name])
        for number in np.unique(rows.recording):
            own = rows.recording == number
            rest[own] -= np.median(rest[own])
        return rest


def law_change(rows: CommandRegression, law: ControlLaw, joint: int, period: float) -> LawChange:
    """Add the best group until none is acceptable, and drop those that are not needed.

    Parameters
    ----------
    period
        Of the control, s.
    """
    change = _change_of(rows, law, joint, period)
    on_time = _with_reference_on_time(change, rows, law, joint, period)
    if on_time is not None:
        change = _change_of(on_time, law, joint, period)
    steady = _steady(change, rows if on_time is None else on_time)
    return change if steady is None else _change_of(steady, law, joint, period)


def _change_of(rows: CommandRegression, law: ControlLaw, joint: int, period: float) -> LawChange:
    change = _chosen(_with_late_speed(rows, law, joint, period, ()), law, joint, period)
    if not change.groups:
        return change
    # How late the speed is shows only beside the group that differs most.
    again = _with_late_speed(rows, law, joint, period, change.groups[:1])
    better = _chosen(again, law, joint, period)
    return better if better.groups else change


def _chosen(rows: CommandRegression, law: ControlLaw, joint: int, period: float) -> LawChange:
    plain = fit = rows.fit((), with_lag=True)
    chosen: tuple[str, ...] = ()
    while True:
        better = {}
        for name in GROUPS:
            if name in chosen or not rows.usable(name):
                continue
            names = (*chosen, name)
            larger = rows.fit(names, with_lag=True)
            certain = _certain(rows, law, joint, names, larger, period)
            if not (certain and acceptable(rows, fit, larger)):
                continue
            calm = rows.only(without_best(fit, larger))
            if supported(calm, calm.fit(chosen, with_lag=True), calm.fit(names, with_lag=True)):
                better[name] = larger
        if not better:
            break
        name = max(better, key=lambda each: better[each].log_likelihood)
        chosen, fit = (*chosen, name), better[name]
    for name in chosen:
        rest = tuple(other for other in chosen if other != name)
        smaller = rows.fit(rest, with_lag=True)
        if not acceptable(rows, smaller, fit):
            chosen, fit = rest, smaller
    return LawChange(rows, chosen, plain, fit)


def acceptable(rows: CommandRegression, smaller: Fit, larger: Fit) -> bool:
    """Whether one number more is supported and takes enough of the energy."""
    share = 1.0 - (rms(larger) / max(rms(smaller), 1e-300)) ** 2
    return supported(rows, smaller, larger) and bool(share >= settings.LAW_LEAST_SHARE)


def supported(rows: CommandRegression, smaller: Fit, larger: Fit) -> bool:
    """Whether one number more is worth its cost."""
    gain = larger.log_likelihood - smaller.log_likelihood - 0.5 * float(np.log(len(rows.rest)))
    return bool(gain >= settings.LEAST_SUPPORT)


def without_best(smaller: Fit, larger: Fit) -> NDArray[np.bool_]:
    """Rows (r,) without the blocks of time in which the larger model gains most.

    Another law acts all the time. In a shock, efforts that are sampled more slowly than the law
    runs, or at another instant, differ from every law: one row of it can outweigh a recording.
    """
    gain = smaller.residuals[0] ** 2 - larger.residuals[0] ** 2
    block = np.arange(len(gain)) * int(settings.LAW_BLOCKS) // len(gain)
    order = np.argsort(np.bincount(block, gain))
    return ~np.isin(block, order[-int(settings.LAW_BLOCKS_LEFT_OUT) :])


def _steady(change: LawChange, rows: CommandRegression) -> CommandRegression | None:
    """Rows beside no event that law and change leave; None where they are all, or little is left.

    Another law differs between events, too, and leaves nothing of what it explains. `rows` are
    those of the change before their speed was made late.
    """
    if rms(change.fit) < settings.LAW_LEAST_DIFFERENCE * rows.size:
        return None
    kept = beside_no_event(change.fit.residuals[0], rows.recording, rows.time)
    return None if kept.all() else rows.only(kept)


def _with_late_speed(
    rows: CommandRegression, law: ControlLaw, joint: int, period: float, groups: Sequence[str]
) -> CommandRegression:
    """Compute the command with a speed that is as late as the recording says, beside groups.

    Speeds come from differences of positions: one to two periods late are no mismatch. Nor is one
    that is half a sample earlier than the speed that was found for all joints: of a law that runs
    faster than its record, that is no closer.
    """
    earliest = -settings.LAG_DIFFERENCE * max(period, rows.step)
    longest = settings.LONGEST_LAG * period
    _, kd, _ = (float(gain[joint]) for gain in law.torque_gains)
    late = kd * rows.acceleration
    name = "late speed"
    with_late = replace(rows, groups={**rows.groups, name: late})
    if kd <= 0.0 or not with_late.usable(name):
        return rows
    names = (*groups, name)
    lag, deviation = rows.changes(with_late.fit(names, with_lag=True), names)[name]
    if not earliest < lag < longest + settings.CLEAR_DEVIATIONS * deviation:
        return rows
    return replace(rows, rest=rows.rest - lag * late)


def _with_reference_on_time(
    change: LawChange, rows: CommandRegression, law: ControlLaw, joint: int, period: float
) -> CommandRegression | None:
    """Compute the command with a reference that is as late as the recording says.

    A reference that is stamped when it is sent acts up to a period later, which looks like a
    feedforward of −kp · lag over its velocity: no mismatch. None where there is no such thing.
    """
    name = "feedforward_velocity"
    kp, _, _ = (float(gain[joint]) for gain in law.torque_gains)
    little = rms(rows.fit((), with_lag=False)) < settings.LAW_LEAST_DIFFERENCE * rows.size
    if little or name not in change.groups:
        return None
    value, deviation = change.changes[name]
    if not 0.0 < -value < period * kp + settings.CLEAR_DEVIATIONS * deviation:
        return None
    return replace(rows, rest=rows.rest - value * rows.groups[name])


def _certain(
    rows: CommandRegression,
    law: ControlLaw,
    joint: int,
    names: Sequence[str],
    fit: Fit,
    period: float,
) -> bool:
    """Whether the last change is larger than what noise and sampling make of the law."""
    name = names[-1]
    change = abs(rows.changes(fit, names)[name][0])
    kp, kd, _ = (float(gain[joint]) for gain in law.torque_gains)
    floor: Mapping[str, float] = {
        "kp": settings.LAW_NOISE_MARGIN * rows.noise["kp"] * kp,
        # A speed that is one period old looks like this much less of its gain.
        "kd": settings.LAW_NOISE_MARGIN * rows.noise["kd"] * kd + period * kp,
    }
    return change > floor.get(name, 0.0)
