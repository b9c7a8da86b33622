"""Whether the recorded commands are those of the configured control law, and what differs.

The search is that of the torque. Its rows are recorded less computed commands, its numbers the
errors of the recording with their likely sizes, its candidates the groups of the law.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from idim_iv_ros.diagnosis import sentences, settings
from idim_iv_ros.diagnosis.comparison.compare import Comparison
from idim_iv_ros.diagnosis.comparison.model_with_terms import ModelWithTerms, Term
from idim_iv_ros.diagnosis.comparison.named_columns import NamedColumns, ledger_of_rows, supported
from idim_iv_ros.diagnosis.comparison.refine import together
from idim_iv_ros.diagnosis.comparison.select import select
from idim_iv_ros.diagnosis.refit.baseline import Baseline
from idim_iv_ros.diagnosis.refit.command_rows import (
    TIMES,
    CommandRows,
    LawCommands,
    LawSpeed,
    away_from_events,
    events_in,
    law_speed,
)
from idim_iv_ros.diagnosis.refit.refit import delay_of_all, is_beyond_control
from idim_iv_ros.diagnosis.result.causes import Cause, Evidence, Gap
from idim_iv_ros.effects.cause import EffectParameter
from idim_iv_ros.effects.registry import BY_NAME, CONTROL_LAW, ENCODER_LAWS
from idim_iv_ros.estimation.likelihood import rms
from idim_iv_ros.estimation.qr import independent_basis
from idim_iv_ros.simulation import ControlLaw
from idim_iv_ros.statistics.bootstrap import block_sums
from idim_iv_ros.types import FloatArray

_ON_TIME, _POSITIVE = EffectParameter(0.0, 0.0, "s"), EffectParameter(1.0, 0.0, "")
_SAME_NUMBER = 0.1  # relative: what instruments change of it is a detail of the law
_UNSURE = 2e-3  # of the commands: noise that rows have at least, or nothing else would be likely


@dataclass(frozen=True)
class LawChange:
    """What differs from the configured law at one joint."""

    every: CommandRows
    rows: CommandRows  # those that are not near an event
    comparison: Comparison
    terms: tuple[Term, ...]  # groups that differ; of two sets, those of the second have a scope
    too_noisy: bool = False  # there were some, but they follow noise of the motion

    @cached_property
    def model(self) -> ModelWithTerms:
        """The law with these terms and errors of the recording."""
        return ModelWithTerms(self.comparison.nominal, self.terms)

    @property
    def lag(self) -> tuple[float, float]:
        """(value, std) of the lag of the effort, s, that all errors of time together make."""
        nominal, model, rate = self.comparison.nominal, self.model, self.rows.errors[:, 0]
        part = np.zeros(len(nominal.root))
        part[:TIMES] = rate @ self.rows.errors / max(float(rate @ rate), 1e-300)
        moved = [part @ nominal.products_of(term).moved for term in self.terms]
        moving = np.concatenate([np.zeros(0), *moved])
        spread = float(np.sum((part @ nominal.root) ** 2) + moving @ model.covariance @ moving)
        return self.rows.lag + float(part @ model.errors), spread**0.5

    @property
    def changes(self) -> dict[str, tuple[float, float]]:
        """(value, std) of each group that differs in all rows."""
        return {
            term.key.effect: (float(term.coefficients[0]), float(term.deviations[0]))
            for term in self.terms
            if not term.key.scope
        }

    @cached_property
    def follows_noise(self) -> bool:
        """Whether other numbers come out with the rows before and after as instruments.

        Noise of the positions is in the commands that the law makes of them, and in its groups: it
        makes them smaller. Neighbouring rows have the same motion and other noise. A test as that
        of Hausman (1978), with deviations of the difference by blocks of time.
        """
        if not self.terms:
            return False
        constants = independent_basis(self.rows.constants)
        errors = self.rows.errors @ self.model.errors[: self.rows.errors.shape[1]]
        rest = constants.remove(self.rows.rest - errors)
        columns = constants.remove(np.column_stack([term.columns[0] for term in self.terms]))
        instruments = np.zeros_like(columns)
        for run in self.rows.runs:
            inside = columns[run]
            instruments[run][1:-1] = 0.5 * (inside[2:] + inside[:-2])
        instruments = constants.remove(instruments)
        one, other = np.linalg.pinv(columns), np.linalg.pinv(instruments.T @ columns)
        apart = other @ instruments.T - one
        left = rest - columns @ (one @ rest)
        sums = block_sums(self.comparison.options.ledger.blocks[0], (apart * left).T)
        deviations = np.sqrt(np.sum(sums**2, axis=0))
        change, numbers = np.abs(apart @ rest), np.abs(one @ rest)
        least = np.maximum(settings.CLEAR_DEVIATIONS * deviations, _SAME_NUMBER * numbers)
        return bool(np.any(change > least))

    @property
    def before(self) -> float:
        """RMS of what the errors of the recording alone leave, N m (N)."""
        return rms(ModelWithTerms(self.comparison.nominal, ()).residuals[0])

    def left_of_lag(self, lag: float) -> float:
        """RMS of what an effort that is late by `lag`, s, leaves, all else on time, N m (N)."""
        rest = self.rows.rest - (lag - self.rows.lag) * self.rows.errors[:, 0]
        return rms(independent_basis(self.rows.constants).remove(rest))

    @property
    def beyond(self) -> FloatArray:
        """(r,) what the commands of all rows hold beyond the law and its change, N m (N)."""
        rows = self.every
        rest = rows.rest - rows.errors @ self.model.errors[:TIMES]
        for name, (value, _) in self.changes.items():
            rest = rest - value * rows.groups[name]
        for number in np.unique(rows.recording):
            inside = rows.recording == number
            rest[inside] -= np.median(rest[inside])
        return rest

    @property
    def is_followed(self) -> bool:
        """Whether the commands hold little beyond the law: nothing else is late."""
        return rms(self.beyond) < settings.MUCH_BEYOND_LAW * self.every.size


def law_change(every: CommandRows) -> LawChange:
    """Search for the groups of the law that explain what the commands have beyond it."""
    rows = every
    # A pulse is plain where the law holds, and where it does not beside what all groups leave.
    for more in ([], [rows.errors, *rows.groups.values()]):
        rest = rows.left_by(*more)
        if rms(rest) >= settings.LAW_LEAST_DIFFERENCE * rows.size:
            calm = away_from_events(rest, rows.recording, rows.time)
            if not calm.all():
                rows = rows.only(calm)
                break
    # The numbers of the comparison are the errors of the recording, and then the constants.
    ledger = ledger_of_rows(
        rows.rest, rows.size, rows.errors, rows.likely, rows.constants, rows.runs
    )
    selection = select(NamedColumns(rows.groups, rows.second), ledger)
    terms = supported(selection.comparison, selection.terms, settings.LAW_LEAST_SUPPORT)
    large = [term for term in terms if float(term.whole[0]) >= settings.LAW_LEAST_DIFFERENCE]
    change = LawChange(every, rows, selection.comparison, together(selection.comparison, large))
    # Where positions would have to be late by many periods the terms stand for something else.
    late = np.abs(change.model.errors[: len(rows.likely)]) / rows.likely
    if late.max() >= settings.CLEAR_DEVIATIONS:
        return replace(change, terms=())
    if change.follows_noise:
        return replace(change, terms=(), too_noisy=True)
    return change


def why_not_checked(data: Baseline) -> str:
    """Say why the commands cannot be compared with a law; empty where they can."""
    if data.prepared.configuration.controller.type == "unknown":
        return "the configuration names no control law"
    if any(motion.signals.position_reference is None for motion in data.prepared.motions):
        return "a recording has no references"
    return ""


@dataclass(frozen=True)
class LawCheck:
    """Recorded commands against the configured law."""

    causes: tuple[Cause, ...] = ()  # one for each joint with another law
    # By which the whole command is larger, at joints where nothing else is another.
    gains: dict[str, float] = field(default_factory=dict)
    speed: LawSpeed | None = None  # that explains the commands best; None: nothing is compared
    beyond: tuple[str, ...] = ()  # of joints whose commands hold much beyond the law, and what
    # One cause where most joints follow the law later than a control of this period makes them.
    delay: tuple[Cause, ...] = ()
    too_noisy: tuple[str, ...] = ()  # joints at which noise of the motion hides what the law is

    def not_shown_by_torque(
        self, data: Baseline, numbers: Sequence[Cause], effects: Sequence[Term]
    ) -> "LawCheck":
        """Leave out other laws that causes (`numbers`) or `effects` of the torque explain.

        A gain of the drive alone changes no command. One of what is recorded changes all of them by
        the inverse of the gain: then both are one cause. Where an encoder is eccentric the commands
        follow another position.
        """
        same: set[str | None] = {
            data.joints[term.place.joint]
            for term in effects
            if set(ENCODER_LAWS) & set(term.effect.laws)
        }
        for cause in numbers:
            factor, scaled = cause.parameters.get("factor"), cause.joint in self.gains
            if factor and scaled and BY_NAME[cause.effect].part == "torque scale":
                apart = abs(1.0 / (1.0 + self.gains[cause.joint or ""]) - factor.value)
                if apart < settings.NORMAL_95 * (factor.std or 0.0):
                    same.add(cause.joint)
        return replace(self, causes=tuple(c for c in self.causes if c.joint not in same))


def check_law(
    data: Baseline,
    without: Collection[str] = (),
    *,
    shift: EffectParameter = _ON_TIME,
    of_joints: Mapping[str, EffectParameter] | None = None,
) -> LawCheck:
    """Compare the recorded efforts with the configured law on the measured motion.

    All samples count, also at reversals, except those at the torque limit. Constants, a lag that
    most joints share and a speed that the law differentiates and filters (`law_speed`) are no
    mismatch, nor is an effort that is no torque. More than two periods of the control from the law
    to the torque on the joints, with what the configuration has, are a delay of all joints: when
    efforts are stamped on the way makes no difference. Empty where nothing can be compared or
    nothing differs; `why_not_checked` says why.

    `shift`: from the recorded effort to the torque on the joints, s (`EffortShift.common`);
    negative where the effort is measured after it acts; `of_joints`: of joints that have another:
    where theirs is earlier the recording is late, and not the law.
    """
    if CONTROL_LAW.name in without or why_not_checked(data):
        return LawCheck()
    commands, speed, joints = shown_law(data)
    law, period = commands.law, commands.period
    configured = data.prepared.configuration.controller.delay
    longest_lag = settings.LONGEST_LAG * period
    usual = longest_lag + configured - shift.value
    for joint, change in joints.items():
        # A loop holds its joint: its stiffness is surely positive, its damping not surely negative.
        numbers = CONTROL_LAW.parameters(law, joint, change.changes)
        stiffness, damping = (numbers.get(name, _POSITIVE) for name in ("kp", "kd"))
        least = stiffness.value - settings.NORMAL_95 * (stiffness.std or 0.0)
        most = damping.value + settings.NORMAL_95 * (damping.std or 0.0)
        if least <= 0.0 or most < 0.0:
            joints[joint] = replace(change, terms=())
    followed = [change for change in joints.values() if change.is_followed]
    longest, shared = _shared_lag(commands, followed, max(usual, longest_lag))
    causes, gains, beyond = [], {}, []
    for joint, change in joints.items():
        theirs = (of_joints or {}).get(data.joints[joint], shift)
        behind = max(shift.value - theirs.value, 0.0)
        behind += settings.CLEAR_DEVIATIONS * (theirs.std or 0.0) if behind > 0.0 else 0.0
        changes, cause = _cause(data, law, joint, change, longest + behind)
        if cause is not None:
            causes.append(cause)
        if set(changes) == {CONTROL_LAW.whole}:
            gains[data.joints[joint]] = changes[CONTROL_LAW.whole][0]
        if not change.is_followed:
            rest, rows = change.beyond, change.every
            events = events_in(rest, rows.recording, rows.time)
            beyond.append(sentences.beyond_the_law(data, joint, rms(rest), rows.size, events))
    delay: tuple[Cause, ...] = ()
    if shared is not None:
        std = float(np.hypot(shared.std or 0.0, shift.std or 0.0))
        late = EffectParameter(shared.value + shift.value - configured, std, "s")
        if is_beyond_control(late.value, std, period):
            before = [change.left_of_lag(max(usual, 0.0)) for change in followed]
            after = [change.before for change in followed]
            said = (
                f"time delay of all joints: efforts act {1e3 * late.value:.2g} ± "
                f"{1e3 * settings.NORMAL_95 * std:.2g} ms "
                f"({late.value / period:.2g} control periods) after the configured law gives them "
                f"from the recorded motion, and are recorded {1e3 * shared.value:.2g} ms after it: "
                "the loop takes that long, or a filter is in it"
            )
            delay = (delay_of_all(late, before, after, said),)
    noisy = tuple(data.joints[joint] for joint, change in joints.items() if change.too_noisy)
    return LawCheck(tuple(causes), gains, speed, tuple(beyond), delay, noisy)


def shown_law(data: Baseline) -> tuple[LawCommands, LawSpeed, dict[int, LawChange]]:
    """Compare the commands of every usable joint with the configured law.

    Returns the commands, the speed that explains them best, and the smallest change that does, of
    joints that have rows enough.
    """
    commands = data.commands
    assert commands is not None
    speed, joints = law_speed(commands), {}
    findings = data.prepared.joint_findings
    wrong = {finding.joint for finding in findings if finding.level == "unusable"}
    for joint in sorted(set(range(len(data.joints))) - wrong):
        rows = commands.late(joint, speed)
        # Of a law that is always beyond its limit no group shows.
        if rows is not None and any(np.ptp(torque) > 0.0 for torque in rows.groups.values()):
            least = _UNSURE * rows.size * np.random.default_rng(0).normal(size=len(rows.rest))
            joints[joint] = law_change(replace(rows, rest=rows.rest + least))
    return commands, speed, joints


def _shared_lag(
    commands: LawCommands, changes: Collection[LawChange], usual: float
) -> tuple[float, EffectParameter | None]:
    """Lag up to which a joint's is no mismatch, s; and that of most joints where they share one.

    `usual`: lag up to which one is that of a control of this period, s.
    """
    if len(changes) < 2:
        return usual, None
    lags, stds = np.array([change.lag for change in changes]).T
    common = max(float(np.sort(lags)[(len(lags) - 1) // 2]), 0.0)  # that of half of the joints
    # Of a recording's interval, at which the law is evaluated, half shows.
    resolution = max(commands.period, 0.5 * commands.interval)
    apart = settings.LAG_DIFFERENCE * max(resolution, common)
    same = np.abs(lags - common) <= apart
    if same.sum() < 2 or 2 * same.sum() <= len(lags):
        return min(usual, common + settings.LAG_DIFFERENCE * resolution), None
    std = float(np.hypot(np.std(lags[same]), np.median(stds)))
    return common + apart, EffectParameter(common, std, "s")


def _cause(
    data: Baseline, law: ControlLaw, joint: int, change: LawChange, longest: float
) -> tuple[dict[str, tuple[float, float]], Cause | None]:
    """What differs from the law at one joint, (value, std) by group, and the cause if it does."""
    changes, statistic = change.changes, 2.0 * sum(term.evidence for term in change.terms)
    before, after = change.before, rms(change.model.residuals[0])
    lag, std = change.lag
    # No law acts before it has measured: a lag below zero is one of the stamps.
    if change.is_followed and lag - settings.CLEAR_DEVIATIONS * std > longest:
        changes[CONTROL_LAW.lag] = lag, std
        statistic += ((lag - longest) / std) ** 2
        before = change.left_of_lag(longest)
    if not changes:
        return changes, None
    # Likelier in the noise of the rows, and further from the commands; or no law of them at all: an
    # integral that winds up where the torque is limited, a reference of another controller.
    if after >= min(before, change.every.size):
        return {}, None
    name = data.joints[joint]
    parameters = data.in_units_at(joint, CONTROL_LAW.parameters(law, joint, changes))
    sentence = (
        f"another control law than configured at {name}: recorded and computed commands differ by "
        f"{sentences.torque(data, before, name)}, and by {sentences.torque(data, after, name)} "
        f"with {sentences.listed_numbers(CONTROL_LAW.name, parameters)}"
    )
    return changes, Cause(
        effect=CONTROL_LAW.name,
        kind="structural",
        joint=name,
        sentence=sentence,
        parameters=parameters,
        evidence=Evidence(statistic),
        torque_gap=Gap.between(before, after),
    )
