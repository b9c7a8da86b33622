"""The refit on the smooth motion: its effort aligned, and gravity where it was missing."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from idim_iv_ros.configuration import Configuration
from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.refit.baseline import Baseline, baseline, nominal_residuals, refit_of
from idim_iv_ros.diagnosis.refit.held_out import row_blocks, stage_of
from idim_iv_ros.diagnosis.refit.signal_chain import EffortShift, aligned
from idim_iv_ros.diagnosis.refit.smooth_motion import measured_motion
from idim_iv_ros.diagnosis.refit.turning_friction import TurningFriction, turning_friction
from idim_iv_ros.diagnosis.result.causes import Cause, Evidence, Gap
from idim_iv_ros.diagnosis.result.document import NotTestable, Stage
from idim_iv_ros.effects.cause import EffectParameter
from idim_iv_ros.effects.registry import STRUCTURAL, name_of
from idim_iv_ros.recording.recording import Recording
from idim_iv_ros.simulation import inverse_dynamics
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


@dataclass(frozen=True)
class MissingGravity:
    """Gravity as the recordings show it, where it is missing on one side or far from configured.

    `acceleration`: (3,) m/s², base frame; `configured`: whether there is another one.

    With the masses of the nominal model. The statistic is that of Wald, with the noise of the model
    that has gravity: without it a joint's residual is so smooth that its noise model takes it for
    noise, and the likelihood hardly separates them. `weightless`: the nominal model without it.
    """

    configured: bool
    acceleration: FloatArray
    deviation: FloatArray
    statistic: float
    weightless: Stage

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
        said = (
            f"{first}, ({shown}) m/s² with the masses of the nominal model. Everything else was "
            f"diagnosed {rest}"
        )
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
            sentence=said,
        )


@dataclass(frozen=True)
class Refit:
    """The model that every candidate is added to, on the smooth motion.

    `shift`: taken out of the effort; `turning`: when dry friction turns, where the simulated loop
    does not tell it best; `gravity`: which the nominal model lacks; `data` has it; `delays`: one
    cause where the shift is longer than the control makes it; `answers_noise`: whether the loop
    answers to that of its encoders, so that nothing can be said of delays.
    """

    data: Baseline
    shift: EffortShift
    turning: TurningFriction
    gravity: MissingGravity | None = None
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
        """Delays at joints that share the shift of all: they have none of their own."""
        chain = self.shift.chain
        if chain.effort_shift.std is None:
            return ()
        shared = [j for j, name in enumerate(self.data.joints) if name not in chain.differing]
        return tuple((name_of("delay"), joint) for joint in shared)

    @property
    def not_testable(self) -> tuple[NotTestable, ...]:
        """Those that are hidden, in words."""
        why = {name_of("delay"): _NOISE_ANSWERED}
        return tuple(
            NotTestable(name, self.data.joints[joint], *why.get(name, _SOFTENED))
            for name, joint in self.hidden
        )


def refitted(
    recordings: Sequence[Recording],
    configuration: Configuration,
    without: Collection[str],
) -> Refit:
    """Refit the nominal model and align the effort; errors as `identify`.

    `without`: effects that are left out of the catalogue: gravity is looked for where the
    configuration has none, unless its direction is among them.
    """
    data = baseline(recordings, configuration)
    may_lack = name_of("gravity") not in without
    gravity = missing_gravity(data) if may_lack else None
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
            early = replace(early, data=early.data.later(0.0), shift=early.shift.undetermined)
            return replace(early, answers_noise=True)
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
    before, after = (
        [np.std(residual).item() for residual in one.regression.fitted.residuals]
        for one in (data, refit.data)
    )
    return replace(refit, delays=(shift.cause(refit.data, before, after, support),))


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
