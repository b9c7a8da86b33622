"""Whether the recorded commands are those of the configured control law."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import stats

from idim_iv_ros.diagnosis import sentences, settings
from idim_iv_ros.diagnosis.controller.command_regression import (
    CommandRegression,
    command_regression,
    rms,
)
from idim_iv_ros.diagnosis.controller.law_change import (
    LawChange,
    acceptable,
    law_change,
    supported,
    without_best,
)
from idim_iv_ros.diagnosis.controller.law_event import events_in
from idim_iv_ros.diagnosis.controller.law_speed import LawSpeed, law_speed
from idim_iv_ros.diagnosis.controller.significance import differs
from idim_iv_ros.diagnosis.refit.baseline import Baseline
from idim_iv_ros.diagnosis.result import (
    NOT_CALIBRATED,
    Cause,
    EffectParameter,
    Evidence,
    Gap,
)
from idim_iv_ros.diagnosis.structural.candidate import Candidate
from idim_iv_ros.effects.controller_mismatch import GROUPS, LAG, ControllerMismatch
from idim_iv_ros.effects.registry import ENCODER_LAWS
from idim_iv_ros.simulation import ControlLaw, control_law, control_period


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
        Corrected for the choice among groups and joints (Bonferroni).
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


def check_law(data: Baseline, without: Collection[str] = (), *, shift: float = 0.0) -> LawCheck:
    """Compare the recorded efforts with the configured law on the measured motion.

    All samples count, also at reversals, except those at the torque limit. Constants, a lag that
    most joints share, of up to two periods of the control until the effort acts, and a speed that
    the law differentiates and filters (`law_speed`) are no mismatch, nor is an effort that is no
    torque. Empty where nothing can be compared or nothing differs; `why_not_checked` says why.

    Parameters
    ----------
    shift
        Common time from the recorded effort to the torque on the joints, s (`signal_chain`);
        negative where the effort is measured after it acts: it is late by that, and not the law.
    """
    if ControllerMismatch.name in without or why_not_checked(data):
        return LawCheck()
    configuration = data.prepared.configuration
    law = control_law(configuration.controller, len(data.joints))
    rates = [motion.signals.rate for motion in data.prepared.motions]
    period = control_period(configuration.controller, rates)
    speed = law_speed(data.prepared.motions, law)
    compared, every = {}, {}
    wrong = {each.joint for each in data.prepared.joint_findings if each.level == "unusable"}
    for joint in sorted(set(range(len(data.joints))) - wrong):
        rows = command_regression(data.prepared.motions, law, joint, speed)
        if rows is not None:
            compared[joint] = law_change(rows, law, joint, period)
            every[joint] = rows
    longest = _longest_lag(list(compared.values()), period, shift)
    found = [_finding(data, law, joint, change, longest) for joint, change in compared.items()]
    beyond = [
        _beyond_the_law(data, joint, change, every[joint]) for joint, change in compared.items()
    ]
    return LawCheck(
        findings=tuple(finding for finding in found if finding is not None),
        speed=speed,
        beyond=tuple(sentence for sentence in beyond if sentence),
    )


def controller_causes(data: Baseline, law: LawCheck, effects: Sequence[Candidate]) -> list[Cause]:
    """One cause for each joint whose commands are not those of the configured law.

    Parameters
    ----------
    effects
        Accepted ones: where an encoder is eccentric the commands follow another position.
    """
    eccentric = {each.place.joint for each in effects if set(ENCODER_LAWS) & set(each.effect.laws)}
    found = [(data.joints.index(each.joint), each) for each in law.findings]
    return [_cause(data, joint, each) for joint, each in found if joint not in eccentric]


def _cause(data: Baseline, joint: int, found: ControllerFinding) -> Cause:
    parameters = data.in_units_at(joint, found.parameters)
    gap = Gap(found.before, found.after, None, 1.0 - found.after / found.before, None)
    return Cause(
        effect=found.effect.name,
        kind="structural",
        joint=found.joint,
        other_joint=None,
        parameters=parameters,
        evidence=Evidence(found.statistic, None, None, "", p_value_from=NOT_CALIBRATED),
        indistinguishable_from=(),
        torque_gap=gap,
        simulation_gap=None,
        sentence=sentences.controller_cause(data, joint, gap, found.effect.name, parameters),
    )


def _beyond_the_law(data: Baseline, joint: int, change: LawChange, rows: CommandRegression) -> str:
    """What the commands hold beyond the law and its smallest change; empty where it is little."""
    rest = change.beyond(rows)
    size, command = float(np.sqrt(np.mean(rest**2))), rows.size
    if size < settings.MUCH_BEYOND_LAW * command:
        return ""
    return sentences.beyond_the_law(
        data, joint, (size, command), events_in(rest, rows.recording, rows.time)
    )


def _longest_lag(compared: Sequence[LawChange], period: float, shift: float) -> float:
    """Lag up to which a joint's is no mismatch, s: that of half of the joints, and a little."""
    longest = settings.LONGEST_LAG * period + max(-shift, 0.0)
    if len(compared) < 2:
        return longest
    lags = sorted(each.changes[LAG][0] for each in compared)
    common = max(lags[(len(lags) - 1) // 2], 0.0)
    return min(longest, common + settings.LAG_DIFFERENCE * period)


def _holds_lag(rows: CommandRegression, short: CommandRegression, change: LawChange) -> bool:
    """Whether the lag is needed beyond that of `short`, also without where it helps most."""
    smaller = short.fit(change.groups, with_lag=False)
    if not acceptable(rows, smaller, change.fit):
        return False
    calm = without_best(smaller, change.fit)
    rows, short = rows.only(calm), short.only(calm)
    larger = rows.fit(change.groups, with_lag=True)
    return supported(rows, short.fit(change.groups, with_lag=False), larger)


def _finding(
    data: Baseline, law: ControlLaw, joint: int, change: LawChange, longest: float
) -> ControllerFinding | None:
    rows, fit, base = change.rows, change.fit, change.plain
    little = settings.LAW_LEAST_DIFFERENCE * rows.size
    if rms(rows.fit((), with_lag=False)) < little:
        return None
    changes = change.changes
    lag, deviation = changes.pop(LAG)
    # No law acts before it has measured: a lag below zero is one of the stamps.
    if lag - settings.LAG_DEVIATIONS * deviation > longest:
        short = replace(rows, rest=rows.rest + longest * rows.rate)
        if _holds_lag(rows, short, change):
            changes[LAG] = (lag, deviation)
            base = short.fit((), with_lag=False)
    if LAG not in changes and rms(base) < little:  # what an ordinary lag leaves
        return None
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
