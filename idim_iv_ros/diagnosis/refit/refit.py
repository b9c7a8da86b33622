"""The refit on the smooth motion: its effort aligned, and gravity where it was missing.

How late the recorded effort acts is a property of the recording, the same for all joints. A law at
period T computes its command from samples at t and the drive holds it until t + T: taken as a
signal at t, the torque acts T/2 late, and later with every period of computing time. The drives of
one robot share this, so that it is estimated once and taken out before causes are looked for. What
a single joint has beyond it stays in the data, where `time_delay` finds it; a shift that is longer
than that is a cause itself.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from idim_iv_ros.configuration import Configuration
from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.refit.baseline import Baseline, baseline, nominal_residuals, refit_of
from idim_iv_ros.diagnosis.refit.held_out import row_blocks, stage_of
from idim_iv_ros.diagnosis.refit.smooth_motion import measured_motion
from idim_iv_ros.diagnosis.refit.turning_friction import TurningFriction, turning_friction
from idim_iv_ros.diagnosis.result.causes import Cause, Evidence, Gap, JointChange
from idim_iv_ros.diagnosis.result.document import NotTestable, Stage
from idim_iv_ros.diagnosis.result.recordings import SignalChain
from idim_iv_ros.effects.cause import EffectParameter
from idim_iv_ros.effects.registry import STRUCTURAL, name_of
from idim_iv_ros.recording.recording import Recording
from idim_iv_ros.simulation import control_period, inverse_dynamics
from idim_iv_ros.statistics.bootstrap import energies
from idim_iv_ros.types import FloatArray

_STANDARD_GRAVITY = 9.81  # m/s², that is put in
_LIKELY_GRAVITY = (4.0, 25.0)  # m/s², with the given masses, or it is something else
_COMPENSATED = 0.3  # of the configured gravity: with less, efforts hold none but errors of masses
_NEAR = 0.825  # cosine of 0.6 rad, up to which the effect gravity_direction is made
_SOFTENED = (
    "dry friction turns before the joint, as a simulator solves it: what friction does at a "
    "reversal is its solver's",
    "a recording of a robot, or of a simulator without softened friction",
)
_NOISE_ANSWERED = (
    "the loop answers to the steps of coarse encoders, which looks late: measured and simulated "
    "motion show another shift of the effort",
    "encoders with more bits, or faster motion",
)
_LEAST_SHARE = 0.2  # of the energy of one joint's residual, that gravity takes
_EARLIEST_SHIFT = -1.0  # control periods: what a single joint tells of the recording
# Joints that share a long shift: friction that falls with the speed looks late at every joint, and
# at every one by another time.
_SHARED = 0.75
_FALLING = (0.03, 0.1)  # of the largest speed: over which friction may fall
_SHIFT_STEPS = 2  # fits of the shift, which enters the regression to first order only


@dataclass(frozen=True)
class MissingGravity:
    """Gravity as the recordings show it, where it is missing on one side or far from configured.

    With the masses of the nominal model. The statistic is that of Wald, with the noise of the model
    that has gravity: without it a joint's residual is so smooth that its noise model takes it for
    noise, and the likelihood hardly separates them.
    """

    configured: bool  # whether the configuration has one, another than this
    acceleration: FloatArray  # (3,) m/s², base frame
    deviation: FloatArray  # (3,) m/s²
    statistic: float
    weightless: Stage  # the nominal model without it

    @property
    def compensated(self) -> bool:
        """Whether the efforts hold none, and the model has one."""
        return float(np.linalg.norm(self.acceleration)) < _LIKELY_GRAVITY[0]

    def corrected(self, configuration: Configuration) -> Configuration:
        """Return the configuration with none, or one of the usual size in this direction."""
        size = 0.0 if self.compensated else _STANDARD_GRAVITY
        vector = size * self.acceleration / np.linalg.norm(self.acceleration)
        return configuration.changed("robot", gravity=vector.tolist())

    def cause(self, with_gravity: Stage) -> Cause:
        """Build the cause from the nominal model with gravity."""
        stages = (self.weightless, with_gravity)
        gaps = [float(np.linalg.norm(list(stage.torque_rms.values()))) for stage in stages]
        shown = ", ".join(f"{value:.2g}" for value in self.acceleration)
        lacks = "another direction of" if self.configured else "no"
        first = f"the nominal model has {lacks} gravity, but the recordings show it"
        rest = "with gravity in this direction"
        if self.compensated:
            first = "the efforts hold no gravity: the driver records them without what balances it"
            rest = "without gravity. Record the whole effort, or set robot.gravity to zero"
        return Cause(
            effect=name_of("gravity"),
            kind="parametric",
            joint=None,
            parameters={
                f"gravity_{axis}": EffectParameter(float(value), float(std), "m/s²")
                for axis, value, std in zip("xyz", self.acceleration, self.deviation, strict=True)
            },
            evidence=Evidence(self.statistic),
            torque_gap=Gap.between(*gaps),
            sentence=f"{first}, ({shown}) m/s² with the masses of the nominal model. Everything "
            f"else was diagnosed {rest}",
        )


@dataclass(frozen=True)
class EffortShift:
    """Time from the recorded effort to the torque on the joints, s.

    `chain`: as it is reported, without the speed of the law; positive where the effort is recorded
    before it acts.
    """

    chain: SignalChain
    period: float  # of the control
    configured: float  # delay that the configured law has

    @property
    def common(self) -> EffectParameter:
        """Shift of all joints that do not differ; zero, with no deviation, where there is none."""
        return self.chain.effort_shift

    @property
    def beyond_control(self) -> bool:
        """Whether nearly all joints share more than a command makes that is held and computed."""
        shift, joints = self.common, len(self.chain.joint_shifts)
        shared = joints - len(self.chain.differing)
        if shift.std is None or shared < 2 or shared < _SHARED * joints:
            return False
        return is_beyond_control(shift.value - self.configured, shift.std, self.period)

    def cause(self, before: Baseline, after: Baseline, support: float) -> Cause:
        """Build the cause from the refits without and with the shift.

        `support`: by how much the logarithm of the likelihood is higher with the delay in the loop;
        0 where no loop is simulated.
        """
        delay = replace(self.common, value=self.common.value - self.configured)
        assert delay.std is not None
        one, other = (
            [np.std(residual).item() for residual in data.regression.fitted.residuals]
            for data in (before, after)
        )
        pairs = enumerate(zip(one, other, strict=True))
        changes = [after.joint_change(joint, *of_joint) for joint, of_joint in pairs]
        changes.sort(key=lambda change: -change.share_of_torque)
        which = "which this recording cannot tell"
        if abs(support) >= settings.LEAST_SUPPORT:
            which = f"the motion is that of a loop with{'' if support > 0.0 else 'out'} the delay"
        half = 1e3 * settings.NORMAL_95 * delay.std
        sentence = (
            f"time delay of all joints: efforts act {1e3 * delay.value:.3f} ± {half:.2g} ms "
            f"after their stamps ({delay.value / self.period:.2f} control periods, of which a "
            "held command takes half a one): the stamps are early, or commands take that long "
            f"in the loop; {which}. Everything else was diagnosed with efforts at the time at "
            "which they act"
        )
        return delay_of_all(delay, one, other, sentence, changes)

    @property
    def sentence(self) -> str:
        """Say it with its size in periods of the control."""
        shift = self.common.value
        if self.common.std is None:
            return "the effort's common shift in time cannot be determined on this recording"
        half = 1e3 * settings.NORMAL_95 * self.common.std
        text = (
            f"the effort is recorded {1e3 * abs(shift):.3f} ± {half:.2g} ms "
            f"{'before' if shift >= 0.0 else 'after'} it acts "
            f"({abs(self.chain.periods):.2f} control periods), and aligned by that"
        )
        if shift >= 0.0:
            text += ": a command that is held over its period acts half a period late"
        for name in self.chain.differing:
            value = self.chain.joint_shifts[name].value
            when = "before" if value >= 0.0 else "after"
            text += f"; that of {name} {1e3 * abs(value):.3g} ms {when} it acts"
        return text


@dataclass(frozen=True)
class Refit:
    """The model that every candidate is added to, on the smooth motion.

    `delays`: one cause where the shift is longer than the control makes it; `answers_noise`:
    whether the loop answers to that of its encoders, so that nothing can be said of delays.
    """

    data: Baseline
    shift: EffortShift  # taken out of the effort
    turning: TurningFriction  # when dry friction turns, where the simulated loop does not tell
    gravity: MissingGravity | None = None  # which the nominal model lacks; `data` has it
    delays: tuple[Cause, ...] = ()
    answers_noise: bool = False

    @property
    def hidden(self) -> tuple[tuple[str, int], ...]:
        """Effects that act where joints turn, at joints whose dry friction a solver softens.

        And delays, where the loop answers to the noise of its encoders.
        """
        lost = [effect.name for effect in STRUCTURAL if effect.lost_where_softened]
        late = range(len(self.data.joints)) if self.answers_noise else ()
        return (
            *((name, joint) for name in lost for joint in self.turning.soft),
            *((name_of("delay"), joint) for joint in late),
        )

    @property
    def on_time(self) -> tuple[tuple[str, int], ...]:
        """Delays at joints whose effort is no later than those of the others: they have none."""
        chain, shift = self.shift.chain, self.shift
        if chain.effort_shift.std is None:
            return ()
        shared = [j for j, name in enumerate(self.data.joints) if name not in chain.differing]
        shifts = [chain.joint_shifts[self.data.joints[joint]] for joint in shared]
        values, stds = np.array([(one.value, one.std or np.inf) for one in shifts]).T
        weights = (1.0 - np.eye(len(shared))) / stds**2  # of the other joints
        total = np.maximum(weights.sum(axis=1), 1e-300)
        apart, unsure = values - weights @ values / total, np.hypot(stds, total**-0.5)
        room = settings.SHIFT_AGREEMENT * shift.period + settings.CLEAR_DEVIATIONS * unsure
        return tuple((name_of("delay"), shared[k]) for k in np.flatnonzero(apart <= room))

    @property
    def not_testable(self) -> tuple[NotTestable, ...]:
        """Those that are hidden, in words."""
        why = {name_of("delay"): _NOISE_ANSWERED}
        return tuple(
            NotTestable(name, self.data.joints[joint], *why.get(name, _SOFTENED))
            for name, joint in self.hidden
        )


def refitted(
    recordings: Sequence[Recording], configuration: Configuration, without: Collection[str]
) -> Refit:
    """Refit the nominal model and align the effort; errors as `identify`.

    `without`: effects that are left out of the catalogue: gravity is looked for where the
    configuration has none, unless its direction is among them.
    """
    data = baseline(recordings, configuration)
    gravity = None if name_of("gravity") in without else missing_gravity(data)
    if gravity is not None:
        data = baseline(recordings, gravity.corrected(configuration))
    return replace(_aligned_throughout(data, without), gravity=gravity)


def _aligned_throughout(data: Baseline, without: Collection[str]) -> Refit:
    """Align the effort; where it is far too early, before the model is fitted as well.

    A refit to such efforts takes the delay for friction and inertia, and the motion and the dry
    friction that are simulated with those are wrong where joints turn. So are those of a loop
    without the delay, if it is one of the loop: the likelier motion decides.
    """
    early = on_likelier_motion(data)
    if not early.shift.beyond_control:
        return early
    if data.sticking:
        # A loop answers to the steps of coarse encoders, which are in the measured motion and in
        # the command: that looks late, by another time in the measured and the simulated motion.
        first, second = (aligned(motion)[1].common for motion in (data, _on_measured(data)))
        unsure = float(np.hypot(first.std or 0.0, second.std or 0.0))  # of the same torque's noise
        room = settings.SHIFT_AGREEMENT * max(early.shift.period, abs(first.value))
        if abs(first.value - second.value) > unsure + room:
            none = EffectParameter(0.0, None, "s")
            shift = replace(
                early.shift, chain=replace(early.shift.chain, effort_shift=none, periods=0.0)
            )
            return replace(early, data=early.data.later(0.0), shift=shift, answers_noise=True)
    delay, prepared, support = early.shift.common.value, data.prepared, 0.0
    of_stamps = refit_of(prepared, delay)
    refit = on_likelier_motion(of_stamps)
    if of_stamps.sticking:
        delayed = prepared.configuration.changed("controller", delay=delay)
        other = on_likelier_motion(refit_of(replace(prepared, configuration=delayed), delay))
        support = _likelihood(other) - _likelihood(refit)
        refit = max(refit, other, key=_likelihood)
    shift = replace(refit.shift, configured=early.shift.configured)
    if name_of("delay") in without or not shift.beyond_control:
        return refit
    return replace(refit, delays=(shift.cause(data, refit.data, support),))


def on_likelier_motion(data: Baseline) -> Refit:
    """Align the effort on the motion that is likelier: joined with the simulated one, or measured.

    Where friction or loop are not what is simulated, the simulated part of the motion is wrong;
    where encoders are coarse, the measured one is.
    """
    joined = _with_friction(data)
    if not data.sticking:
        return joined
    return max(joined, _with_friction(_on_measured(data)), key=_likelihood)


def _on_measured(data: Baseline) -> Baseline:
    return data.on(tuple(map(measured_motion, data.motions, data.prepared.motions)))


def _likelihood(refit: Refit) -> float:
    return float(refit.data.regression.fitted.log_likelihood)


def _with_friction(data: Baseline) -> Refit:
    """Align the effort; once more where dry friction turns otherwise than in the simulated loop."""
    shifted, shift = aligned(data)
    turning = turning_friction(shifted)
    if turning.leads:
        shifted, shift = aligned(turning.put_into(data))
    return Refit(shifted, shift, turning)


def missing_gravity(data: Baseline) -> MissingGravity | None:
    """Look for gravity where the configuration has none, or one that is far from it.

    Or for efforts without gravity, where it is configured. None where the configured direction is
    near it, as those are that the search corrects to first order, and where nothing shows.
    """
    robot = data.prepared.model.robot
    configured = robot.gravity
    if data.prepared.why_no_given:
        return None
    columns, regression = unit_gravity_rows(data, np.eye(3)), data.regression
    plain = regression.fitted
    heavy = regression.with_columns(dict(enumerate(columns))).fit()
    # A direction that no joint feels has no variance: a planar arm's, out of its plane.
    weight = np.linalg.pinv(heavy.coefficient_covariance, hermitian=True)
    wald = float(heavy.coefficients @ weight @ heavy.coefficients)
    rows = sum(len(joint.torque) for joint in regression.joints)
    share = max(
        1.0 - float(after @ after) / max(float(before @ before), 1e-300)
        for before, after in zip(plain.residuals, heavy.residuals, strict=True)
    )
    if 0.5 * wald - 1.5 * np.log(rows) < settings.LEAST_SUPPORT or share < _LEAST_SHARE:
        return None
    shown, (low, high) = configured + heavy.coefficients, _LIKELY_GRAVITY
    size = float(np.linalg.norm(shown))
    given = float(np.linalg.norm(configured))
    near = given > 0.0 and float(shown @ configured) > size * given * _NEAR
    if size > _COMPENSATED * given and (not low <= size <= high or near):
        return None
    parts = zip(nominal_residuals(data) or (), row_blocks(data), strict=True)
    weightless = stage_of("given", [energies(*part) for part in parts], data.joints)
    deviation = np.sqrt(np.diag(heavy.coefficient_covariance))
    return MissingGravity(bool(np.any(configured)), shown, deviation, wald, weightless)


def unit_gravity_rows(data: Baseline, accelerations: FloatArray) -> list[FloatArray]:
    """Torque of the given links under each of k gravities (k, 3): (r_j, k) for each joint, N m."""
    robot = data.prepared.model.robot
    tilted = [robot.with_gravity(acceleration) for acceleration in accelerations]
    bodies = robot.given.of_links
    torques = []  # (s, n_joints, k) of each recording
    for motion in data.motions:
        still = np.zeros_like(motion.position)
        static = [inverse_dynamics(tilt, bodies, motion.position, still, still) for tilt in tilted]
        torques.append(np.stack(static, axis=2))
    return [
        data.decimated(joint, [torque[:, joint] for torque in torques])
        for joint in range(len(robot.joints))
    ]


def is_beyond_control(delay: float, std: float, period: float) -> bool:
    """Whether a delay is surely longer than a control of this period makes it; all in s."""
    unsure = settings.SHIFT_AGREEMENT * period + settings.CLEAR_DEVIATIONS * std
    return delay - unsure > settings.LONGEST_LAG * period


def delay_of_all(
    delay: EffectParameter,
    before: Sequence[float],
    after: Sequence[float],
    sentence: str,
    changes: Sequence[JointChange] = (),
) -> Cause:
    """Name a delay that all joints share, with the gap of each joint before and after it."""
    assert delay.std is not None
    gap = Gap.between(float(np.linalg.norm(before)), float(np.linalg.norm(after)))
    return Cause(
        effect=name_of("delay"),
        kind="structural",
        joint=None,
        parameters={"delay": delay},
        evidence=Evidence((delay.value / delay.std) ** 2),
        torque_gap=gap,
        joint_gaps=tuple(changes),
        sentence=sentence,
    )


def aligned(data: Baseline) -> tuple[Baseline, EffortShift]:
    """Estimate the common shift of the effort and take it out of the rows.

    Each joint's shift is the coefficient of dτ/dt in the regression of its torque on the smooth
    motion, fitted together with the base parameters, falling friction and the noise model. The data
    are returned with the torque of their rows at the instants at which it acts.
    """
    controller = data.prepared.configuration.controller
    period = control_period(controller, [motion.signals.rate for motion in data.prepared.motions])
    # Of a single joint nothing tells which of the two it is. Without these columns a Stribeck curve
    # looks late: the torque is higher after a reversal than before.
    falling = _FALLING if len(data.joints) > 1 else ()
    columns = []
    for joint in range(len(data.joints)):
        parts = []
        for motion in data.motions:
            rate = np.gradient(motion.torque[:, joint], 1.0 / motion.rate)
            speed, slip = np.abs(motion.velocity[:, joint]), motion.slip[:, joint]
            falls = speed / max(float(speed.max()), 1e-300)
            parts.append(np.column_stack([rate, *(slip * np.exp(-falls / f) for f in falling)]))
        columns.append({joint: data.decimated(joint, parts)})
    shifted, first = data, slice(None, None, 1 + len(falling))
    for _ in range(_SHIFT_STEPS):
        fit = shifted.regression.with_columns(*columns).fit()
        deviations = np.sqrt(np.maximum(np.diag(fit.coefficient_covariance), 0.0))
        shifts = shifted.shift + fit.coefficients[first]
        chain = _chain(data.joints, shifts, deviations[first], period)
        shifted = data.later(chain.effort_shift.value)
    return shifted, EffortShift(chain, period, controller.delay)


def _chain(
    joints: Sequence[str], shifts: FloatArray, deviations: FloatArray, period: float
) -> SignalChain:
    """Shift that most joints share; of as many, the earliest: a joint can only be later."""
    usable = np.isfinite(deviations) & (deviations > 0.0) & (deviations < period)
    likely = (shifts >= _EARLIEST_SHIFT * period) & (shifts <= settings.LONGEST_LAG * period)
    best, preference = np.zeros(len(shifts), dtype=bool), (0, -np.inf)
    for joint in np.flatnonzero(usable):
        noise = settings.CLEAR_DEVIATIONS * np.hypot(deviations, deviations[joint])
        room = settings.SHIFT_AGREEMENT * period + noise
        agreeing = usable & (np.abs(shifts - shifts[joint]) <= room)
        count = int(agreeing.sum())
        shared = count >= 2 and count >= _SHARED * usable.sum()
        rank = (count, -float(shifts[joint]))
        if (shared or likely[joint]) and rank > preference:
            best, preference = agreeing, rank
    shift, std = 0.0, None
    if best.any():
        weights = 1.0 / deviations[best] ** 2
        shift = float(np.sum(weights * shifts[best]) / weights.sum())
        spread = float(np.sum(weights * (shifts[best] - shift) ** 2) / max(best.sum() - 1, 1))
        std = float(np.sqrt(max(1.0, spread) / weights.sum()))
    pairs = zip(shifts.tolist(), deviations.tolist(), strict=True)
    by_joint = [EffectParameter(s, d if np.isfinite(d) else None, "s") for s, d in pairs]
    return SignalChain(
        effort_shift=EffectParameter(shift, std, "s"),
        periods=shift / period,
        joint_shifts=dict(zip(joints, by_joint, strict=True)),
        differing=tuple(name for name, same in zip(joints, best, strict=True) if not same),
        law_speed=None,
    )
