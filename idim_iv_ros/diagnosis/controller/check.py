"""Whether the recorded commands are those of the configured control law."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import stats

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.controller.command_regression import command_regression, rms
from idim_iv_ros.diagnosis.controller.law_change import LawChange, law_change, worth
from idim_iv_ros.diagnosis.controller.law_speed import LawSpeed, law_speed
from idim_iv_ros.diagnosis.joint_units import unit_at
from idim_iv_ros.diagnosis.parametric.significance import differs
from idim_iv_ros.diagnosis.refit.baseline import Baseline
from idim_iv_ros.diagnosis.result import EffectParameter
from idim_iv_ros.effects.controller_mismatch import GROUPS, LAG, ControllerMismatch
from idim_iv_ros.simulation import ControlLaw, control_law
from idim_iv_ros.types import FloatArray


def beyond_the_law(change: LawChange, joint: str, unit: str, recordings: Sequence[str]) -> str:
    """Say it in one sentence; empty where the law explains the commands.

    Parameters
    ----------
    change
        The smallest change of the law that was found, or none; with its regression.
    joint, unit
        Name, and unit of its torque.
    recordings
        Names, by number.
    """
    rest, size = change.fit.residuals[0], change.rows.size
    much = rms(change.fit)
    if much < settings.MUCH_BEYOND_LAW * size:
        return ""
    text = (
        f"the commands of {joint} hold {much:.3g} {unit} rms beyond the control law "
        f"({100.0 * much / max(size, 1e-300):.0f} % of the command)"
    )
    events = _events(change, rest, recordings)
    if events:
        text += f", most of it {events}"
    return f"{text}: no change of a gain or feedforward explains it"


def _events(change: LawChange, rest: FloatArray, recordings: Sequence[str]) -> str:
    """When it acts, where it does at certain times only; empty where it acts all the time."""
    energy = rest**2
    kurtosis = float(np.mean(energy**2) / max(float(np.mean(energy)) ** 2, 1e-300)) - 3.0
    if kurtosis < settings.LAW_EVENT_KURTOSIS:
        return ""
    large = np.flatnonzero(np.abs(rest) > settings.LAW_EVENT_SIZE * np.median(np.abs(rest)))
    if len(large) == 0:
        return ""
    time, which = change.rows.time[large], change.rows.recording[large]
    cuts = np.flatnonzero((np.diff(which) != 0) | (np.diff(time) > settings.LAW_EVENTS_APART)) + 1
    parts = np.split(large, cuts)
    parts.sort(key=lambda part: -float(energy[part].sum()))
    shown = [
        f"from {change.rows.time[part[0]]:.2f} to {change.rows.time[part[-1]]:.2f} s of "
        f"{recordings[int(change.rows.recording[part[0]])]}"
        for part in parts[: settings.LAW_MOST_EVENTS]
    ]
    more = len(parts) - len(shown)
    return ", ".join(shown) + (f" and {more} more times" if more else "")


@dataclass(frozen=True)
class ControllerFinding:
    """One joint whose commands are not those of the law.

    Attributes
    ----------
    effect : ControllerMismatch
    joint : str
    parameters : dict of str to EffectParameter
        What the robot uses instead, of the groups that differ.
    statistic : float
        Twice the logarithm of the likelihood ratio.
    p_value : float
        With the choice among groups and joints paid for (Bonferroni).
    before, after : float
        RMS of recorded less computed command, N m (N), low-passed as the regression.
    """

    effect: ControllerMismatch
    joint: str
    parameters: dict[str, EffectParameter]
    statistic: float
    p_value: float
    before: float
    after: float


def why_not_checked(data: Baseline) -> str:
    """Say why the commands cannot be compared with a law; empty where they can."""
    if data.prepared.configuration.controller.type == "unknown":
        return "the configuration names no control law"
    if any(motion.signals.position_reference is None for motion in data.prepared.motions):
        return "a recording has no references"
    return ""


@dataclass(frozen=True)
class LawCheck:
    """Recorded commands against the configured law.

    Attributes
    ----------
    findings : tuple of ControllerFinding
        Joints with another law.
    speed : LawSpeed or None
        The speed that explains the commands best; None where nothing can be compared.
    beyond : tuple of str
        What the commands hold beyond the law and its changes, one sentence for each joint where
        it is much.
    """

    findings: tuple[ControllerFinding, ...] = ()
    speed: LawSpeed | None = None
    beyond: tuple[str, ...] = ()


def check_law(data: Baseline) -> LawCheck:
    """Compare the recorded efforts with the configured law on the measured motion.

    All samples count, also at reversals, except those at the torque limit. Constants, a lag of up
    to two periods of the control, common to all joints, and a speed that the law differentiates and
    filters (`law_speed`) are no mismatch. Empty where nothing can be compared or nothing differs;
    `why_not_checked` says why.
    """
    if why_not_checked(data):
        return LawCheck()
    configuration = data.prepared.configuration
    law = control_law(configuration.controller, len(data.joints))
    slowest = min(motion.signals.rate for motion in data.prepared.motions)
    period = configuration.controller.period or 1.0 / slowest
    speed = law_speed(data.prepared.motions, law)
    compared = {}
    for joint in range(len(data.joints)):
        rows = command_regression(data.prepared.motions, law, joint, speed)
        if rows is not None:
            compared[joint] = law_change(rows, law, joint, period)
    longest = _longest_lag(list(compared.values()), period)
    found = [_finding(data, law, joint, change, longest) for joint, change in compared.items()]
    names = [recording.path.name for recording in data.prepared.recordings]
    beyond = [
        beyond_the_law(change, data.joints[joint], unit_at(data, joint, "N m"), names)
        for joint, change in compared.items()
    ]
    return LawCheck(
        findings=tuple(finding for finding in found if finding is not None),
        speed=speed,
        beyond=tuple(sentence for sentence in beyond if sentence),
    )


def _longest_lag(compared: Sequence[LawChange], period: float) -> float:
    """Lag up to which a joint's is no mismatch, s."""
    longest = settings.LONGEST_LAG * period
    if len(compared) < 2:
        return longest
    common = max(min(each.changes[LAG][0] for each in compared), 0.0)
    return min(longest, common + settings.LAG_DIFFERENCE * period)


def _finding(
    data: Baseline, law: ControlLaw, joint: int, change: LawChange, longest: float
) -> ControllerFinding | None:
    rows, fit, base = change.rows, change.fit, change.plain
    if rms(rows.fit((), with_lag=False)) < settings.LAW_LEAST_DIFFERENCE * rows.size:
        return None
    changes = change.changes
    lag, deviation = changes.pop(LAG)
    if abs(lag) - settings.LAG_DEVIATIONS * deviation > longest:
        within = float(np.clip(lag, -longest, longest))
        short = replace(rows, rest=rows.rest + within * rows.rate)
        if worth(rows, short.fit(change.groups, with_lag=False), fit):
            changes[LAG] = (lag, deviation)
            base = short.fit((), with_lag=False)
    if not any(differs(value, deviation) for value, deviation in changes.values()):
        return None
    statistic = 2.0 * float(fit.log_likelihood - base.log_likelihood)
    tried = (len(GROUPS) + 1) * len(data.joints)
    before, after = rms(base), rms(fit)
    return ControllerFinding(
        effect=ControllerMismatch(),
        joint=data.joints[joint],
        parameters=ControllerMismatch().parameters(law, joint, changes),
        statistic=statistic,
        p_value=min(1.0, tried * float(stats.chi2.sf(statistic, len(changes)))),
        before=before,
        after=after,
    )
