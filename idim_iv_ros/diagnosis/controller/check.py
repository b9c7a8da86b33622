"""Whether the recorded commands are those of the configured control law."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from idim_iv_ros.diagnosis import sentences, settings
from idim_iv_ros.diagnosis.comparison.model_with_terms import Term
from idim_iv_ros.diagnosis.controller.law_change import (
    CommandRows,
    LawChange,
    command_rows,
    law_change,
)
from idim_iv_ros.diagnosis.refit.baseline import Baseline
from idim_iv_ros.diagnosis.refit.law_speed import LawSpeed, events_in, law_speed
from idim_iv_ros.diagnosis.result import (
    Cause,
    EffectParameter,
    Evidence,
    Gap,
)
from idim_iv_ros.effects.controller_mismatch import GAIN, LAG, ControllerMismatch
from idim_iv_ros.effects.registry import BY_NAME, ENCODER_LAWS, name_of
from idim_iv_ros.simulation import ControlLaw, control_law, control_period


@dataclass(frozen=True)
class ControllerFinding:
    """One joint whose commands are not those of the law.

    Attributes
    ----------
    joint : str
    parameters : dict of str to EffectParameter
        What the robot uses instead, of what differs.
    gain : float or None
        By which the whole command is larger, and nothing else is another; None where it is not.
    statistic : float
        Twice the logarithm of the Bayes factor.
    before, after : float
        RMS of recorded less computed command, N m (N), low-passed as the regression.
    """

    joint: str
    parameters: dict[str, EffectParameter]
    gain: float | None
    statistic: float
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
    delay : tuple of Cause
        One where most joints follow the law later than a control of this period makes them.
    """

    findings: tuple[ControllerFinding, ...] = ()
    speed: LawSpeed | None = None
    beyond: tuple[str, ...] = ()
    delay: tuple[Cause, ...] = ()


def check_law(data: Baseline, without: Collection[str] = (), *, shift: float = 0.0) -> LawCheck:
    """Compare the recorded efforts with the configured law on the measured motion.

    All samples count, also at reversals, except those at the torque limit. Constants, a lag that
    most joints share and a speed that the law differentiates and filters (`law_speed`) are no
    mismatch, nor is an effort that is no torque. A shared lag of more than two periods of the
    control until the effort acts is a delay of all joints. Empty where nothing can be compared or
    nothing differs; `why_not_checked` says why.

    Parameters
    ----------
    shift
        Common time from the recorded effort to the torque on the joints, s (`signal_chain`);
        negative where the effort is measured after it acts: it is late by that, and not the law.
    """
    if ControllerMismatch.name in without or why_not_checked(data):
        return LawCheck()
    shown = shown_law(data)
    late = max(-shift, 0.0)
    shared = SharedLag.of([change for _, change in shown.joints.values()], shown.period, late)
    found = [
        _finding(data, shown.law, joint, change, shared.longest)
        for joint, (_, change) in shown.joints.items()
    ]
    beyond = [
        _beyond_the_law(data, joint, change, rows) for joint, (rows, change) in shown.joints.items()
    ]
    return LawCheck(
        findings=tuple(finding for finding in found if finding is not None),
        speed=shown.speed,
        beyond=tuple(sentence for sentence in beyond if sentence),
        delay=shared.causes(data, shown.joints),
    )


@dataclass(frozen=True)
class ShownLaw:
    """What the commands say of the configured law.

    Attributes
    ----------
    law : ControlLaw
        As configured.
    speed : LawSpeed
    period : float
        Of the control, s.
    joints : dict of int to (CommandRows, LawChange)
        All rows, and the smallest change that explains them, of joints that have enough.
    """

    law: ControlLaw
    speed: LawSpeed
    period: float
    joints: dict[int, tuple[CommandRows, LawChange]]


def shown_law(data: Baseline) -> ShownLaw:
    """Compare the commands of every usable joint with the configured law."""
    section, motions = data.prepared.configuration.controller, data.prepared.motions
    law = control_law(section, len(data.joints))
    period = control_period(section, [motion.signals.rate for motion in motions])
    speed = law_speed(motions, law)
    joints = {}
    wrong = {
        joint_finding.joint
        for joint_finding in data.prepared.joint_findings
        if joint_finding.level == "unusable"
    }
    for joint in sorted(set(range(len(data.joints))) - wrong):
        rows = command_rows(motions, law, joint, speed, period)
        if rows is not None:
            joints[joint] = rows, law_change(rows)
    return ShownLaw(law, speed, period, joints)


@dataclass(frozen=True)
class SharedLag:
    """Time by which the commands of the joints follow the law.

    Attributes
    ----------
    lag, std : float
        That of half of the joints, and its spread over those that share it, s.
    longest : float
        Lag up to which a joint's is no mismatch of its law, s.
    usual : float
        Up to which a lag is that of a control of this period, s.
    period : float
        Of the control, s.
    most : bool
        Whether most joints, two at least, share it.
    """

    lag: float
    std: float
    longest: float
    usual: float
    period: float
    most: bool

    @classmethod
    def of(cls, compared: Sequence[LawChange], period: float, late: float) -> "SharedLag":
        """Compare the lags of the joints; `late`: by which the effort is recorded late, s."""
        usual = settings.LONGEST_LAG * period + late
        if len(compared) < 2:
            return cls(0.0, 0.0, usual, usual, period, False)
        lags, stds = np.array([comparison.lag for comparison in compared]).T
        common = max(float(np.sort(lags)[(len(lags) - 1) // 2]), 0.0)
        apart = settings.LAG_DIFFERENCE * max(period, common)
        same = np.abs(lags - common) <= apart
        most = bool(same.sum() >= 2 and 2 * same.sum() > len(lags))
        std = float(np.hypot(np.std(lags[same]), np.median(stds)))
        longest = common + apart if most else min(usual, common + settings.LAG_DIFFERENCE * period)
        return cls(common, std, longest, usual, period, most)

    def causes(
        self, data: Baseline, joints: Mapping[int, tuple[CommandRows, LawChange]]
    ) -> tuple[Cause, ...]:
        """The delay of all joints, where it is longer than a control of this period makes it."""
        clear = self.lag - settings.CLEAR_DEVIATIONS * self.std > self.usual
        if not (self.most and clear):
            return ()
        delay = EffectParameter(self.lag, self.std, "s")
        one, two = (
            float(np.linalg.norm([np.sqrt(np.mean(rest**2)) for rest in left]))
            for left in (
                [change.left((), self.usual) for _, change in joints.values()],
                [change.left() for _, change in joints.values()],
            )
        )
        cause = Cause(
            effect=name_of("delay"),
            kind="structural",
            joint=None,
            other_joint=None,
            parameters={"delay": delay},
            evidence=Evidence((self.lag / self.std) ** 2),
            indistinguishable_from=(),
            torque_gap=Gap(one, two, None, 1.0 - two / one, None),
            simulation_gap=None,
            sentence=sentences.commands_late(delay, self.period),
        )
        return (cause,)


def beside_gains(law: LawCheck, causes: Sequence[Cause]) -> LawCheck:
    """Leave out commands that are larger by the inverse of a gain that the torque shows.

    A gain of the drive alone changes no command. One of what is recorded changes all of them by
    the inverse of the gain: then both are one cause.
    """
    gains = {
        cause.joint: cause.parameters["factor"]
        for cause in causes
        if BY_NAME[cause.effect].part == "torque scale" and cause.joint is not None
    }

    def same(found: ControllerFinding) -> bool:
        factor = gains.get(found.joint)
        if factor is None or factor.std is None or found.gain is None:
            return False
        return abs(1.0 / (1.0 + found.gain) - factor.value) < settings.NORMAL_95 * factor.std

    return replace(law, findings=tuple(finding for finding in law.findings if not same(finding)))


def controller_causes(data: Baseline, law: LawCheck, effects: Sequence[Term]) -> list[Cause]:
    """One cause for each joint whose commands are not those of the configured law.

    Parameters
    ----------
    effects
        Accepted ones: where an encoder is eccentric the commands follow another position.
    """
    eccentric = {
        effect.place.joint for effect in effects if set(ENCODER_LAWS) & set(effect.effect.laws)
    }
    found = [(data.joints.index(finding.joint), finding) for finding in law.findings]
    return [_cause(data, joint, each) for joint, each in found if joint not in eccentric]


def _cause(data: Baseline, joint: int, found: ControllerFinding) -> Cause:
    parameters = data.in_units_at(joint, found.parameters)
    gap = Gap(found.before, found.after, None, 1.0 - found.after / found.before, None)
    return Cause(
        effect=ControllerMismatch.name,
        kind="structural",
        joint=found.joint,
        other_joint=None,
        parameters=parameters,
        evidence=Evidence(found.statistic),
        indistinguishable_from=(),
        torque_gap=gap,
        simulation_gap=None,
        sentence=sentences.controller_cause(data, joint, gap, ControllerMismatch.name, parameters),
    )


def _beyond_the_law(data: Baseline, joint: int, change: LawChange, rows: CommandRows) -> str:
    """What the commands hold beyond the law and its smallest change; empty where it is little."""
    rest = change.beyond(rows)
    size, command = float(np.sqrt(np.mean(rest**2))), rows.size
    if size < settings.MUCH_BEYOND_LAW * command:
        return ""
    return sentences.beyond_the_law(
        data, joint, (size, command), events_in(rest, rows.recording, rows.time)
    )


def _finding(
    data: Baseline, law: ControlLaw, joint: int, change: LawChange, longest: float
) -> ControllerFinding | None:
    changes, statistic = change.changes, change.statistic
    before, after = change.left(), change.left(change.terms)
    lag, std = change.lag
    # No law acts before it has measured: a lag below zero is one of the stamps.
    if lag - settings.CLEAR_DEVIATIONS * std > longest:
        changes[LAG] = lag, std
        statistic += ((lag - longest) / std) ** 2
        before = change.left((), longest)
    if not changes:
        return None
    one, other = (float(np.sqrt(np.mean(rest**2))) for rest in (before, after))
    return ControllerFinding(
        joint=data.joints[joint],
        parameters=ControllerMismatch().parameters(law, joint, changes),
        gain=changes[GAIN][0] if set(changes) == {GAIN} else None,
        statistic=statistic,
        before=one,
        after=other,
    )
