"""How late the recorded effort acts: a property of the recording, the same for all joints.

A law at period T computes its command from samples at t and the drive holds it until t + T: taken
as a signal at t, the torque acts T/2 late, and later with every period of computing time. The
drives of one robot share this, so that it is estimated once and taken out before causes are looked
for. What a single joint has beyond it stays in the data, where `time_delay` finds it; a shift that
is longer than that is a cause itself.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.refit.baseline import Baseline
from idim_iv_ros.diagnosis.result.causes import Cause, Evidence, Gap, JointChange
from idim_iv_ros.diagnosis.result.recordings import SignalChain
from idim_iv_ros.effects.cause import EffectParameter
from idim_iv_ros.effects.registry import name_of
from idim_iv_ros.simulation import control_period
from idim_iv_ros.types import FloatArray

_EARLIEST_SHIFT = -1.0  # control periods: what a single joint tells of the recording
# Joints that share a long shift: friction that falls with the speed looks late at every joint, and
# at every one by another time.
_SHARED = 0.75
_FALLING = (0.03, 0.1)  # of the largest speed: over which friction may fall
_SHIFT_STEPS = 2  # fits of the shift, which enters the regression to first order only


@dataclass(frozen=True)
class EffortShift:
    """Time from the recorded effort to the torque on the joints, s.

    `chain`: as it is reported, without the speed of the law; positive where the effort is recorded
    before it acts; `period`, `configured`: of the control, and the delay that the configured law
    has.
    """

    chain: SignalChain
    period: float
    configured: float

    @property
    def common(self) -> EffectParameter:
        """Shift of all joints that do not differ; zero, with no deviation, where there is none."""
        return self.chain.effort_shift

    @property
    def undetermined(self) -> "EffortShift":
        """The same where nothing can be said of a shift that all share, which is taken as zero."""
        none = EffectParameter(0.0, None, "s")
        return replace(self, chain=replace(self.chain, effort_shift=none, periods=0.0))

    @property
    def beyond_control(self) -> bool:
        """Whether nearly all joints share more than a command makes that is held and computed."""
        shift, joints = self.common, len(self.chain.joint_shifts)
        shared = joints - len(self.chain.differing)
        if shift.std is None or shared < 2 or shared < _SHARED * joints:
            return False
        return is_beyond_control(shift.value - self.configured, shift.std, self.period)

    def cause(
        self, data: Baseline, before: Sequence[float], after: Sequence[float], support: float
    ) -> Cause:
        """Build the cause from torque gaps of the joints without and with the shift, N m (N).

        `support`: by how much the logarithm of the likelihood is higher with the delay in the loop;
        0 where no loop is simulated.
        """
        delay = replace(self.common, value=self.common.value - self.configured)
        assert delay.std is not None
        pairs = enumerate(zip(before, after, strict=True))
        changes = [data.joint_change(joint, *gaps) for joint, gaps in pairs]
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
        return delay_of_all(delay, before, after, sentence, changes)

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
