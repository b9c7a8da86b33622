"""Shafts and play that encoders behind the gears measure, as results and as causes."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from idim_iv_ros.diagnosis import sentences, settings
from idim_iv_ros.diagnosis.likelihood import Regression, rms
from idim_iv_ros.diagnosis.refit.baseline import Baseline
from idim_iv_ros.diagnosis.result.causes import Cause, Gap
from idim_iv_ros.diagnosis.result.recordings import Transmission, TransmissionSeries
from idim_iv_ros.diagnosis.transmission.twist import (
    DIRECTION,
    LINK_MOTION_STEPS,
    LOAD,
    POSITION,
    RATE,
    SIDE,
    TwistFit,
    compliance,
    fit_twist,
    twist_rows,
)
from idim_iv_ros.effects.cause import EffectParameter, Part
from idim_iv_ros.effects.registry import name_of, part_of
from idim_iv_ros.effects.two_masses import transmitted
from idim_iv_ros.identification.sanity import JointFinding, link_findings

_LEAST_VARIATION = 0.01  # of the largest load: a smaller deviation shows no stiffness
_LIGHT_DAMPING = 0.03  # times critical, of a shaft where none shows
# Hz, of the link against its motor: a shaft is rigid above what the catalogue looks for.
_STIFF_RESONANCE = 100.0
# Play counts as play, and not as part of a shaft, from this share of the shaft's largest bending:
# as `effects.backlash`.
_WIDE = 0.3
_PARTS = ("shaft", "play")


@dataclass(frozen=True)
class Measured:
    """One transmission: what is reported of it, and the fit behind that (None without one)."""

    joint: int
    result: Transmission
    fit: TwistFit | None = None

    @property
    def series(self) -> TransmissionSeries | None:
        """Twist over load for the figure."""
        if self.fit is None:
            return None
        rows, fit = self.fit.rows, self.fit
        followed = fit.accepted(LOAD) * rows.load + fit.accepted(SIDE) * rows.side
        twist = followed + fit.fit.residuals[0]
        return TransmissionSeries(self.result.joint, rows.load, twist, rows.direction)


def measured_transmissions(data: Baseline) -> tuple[Measured, ...]:
    """Measure every joint that has an encoder behind its gear."""
    encoders = link_findings(data.prepared.motions, data.prepared.model.robot.joint_types)
    return tuple(_measured(data, encoder) for encoder in encoders)


def _measured(data: Baseline, encoder: JointFinding) -> Measured:
    joint, name = encoder.joint, data.joints[encoder.joint]
    rows = twist_rows(data, joint)
    reason, count = encoder.sentence if encoder.level == "limited" else "", len(rows.load)
    if count < settings.LEAST_ROWS:
        longer = "record for longer, with this joint moving"
        reason = f"only {count} rows of the encoder behind the gear count: {longer}"
    if reason:
        return Measured(joint, Transmission(joint=name, reason=reason))
    fit = fit_twist(rows)
    for _ in range(LINK_MOTION_STEPS):
        if not fit.clear(LOAD):
            break
        # With the load of links that move as the shaft lets them, refitted as such: a refit that
        # takes the motor's motion for theirs finds heavier links.
        bending, rate = fit.accepted(LOAD), fit.accepted(RATE)
        damping = -rate / bending**2 if rate < 0.0 else None
        gap = 2.0 * max(fit.accepted(SIDE), 0.0)
        elastic = _without_twist(data, joint, 1.0 / bending, damping, gap)
        links = elastic.fit(data.regression.fitted.noise_models).values
        fit = fit_twist(twist_rows(data, joint, bending, links))
        if SIDE in fit.chosen:
            fit = fit_twist(fit.rows.away_from_side_changes())
    return Measured(joint, _transmission(data, joint, fit), fit)


def _transmission(data: Baseline, joint: int, fit: TwistFit) -> Transmission:
    """Everything that the twist of a joint says, with what makes it unsure."""
    rows, angle, (bending, std) = fit.rows, data.unit_at(joint, "rad"), compliance(fit)
    elastic = bending * rows.load
    clear = bending > settings.CLEAR_DEVIATIONS * std
    exceeds_step = float(np.ptp(elastic)) > rows.resolution
    stiffness = damping = most = None
    if LOAD in fit.chosen and clear and exceeds_step:
        unit = data.unit_at(joint, "N m/rad")
        stiffness = EffectParameter(1.0 / bending, std / bending**2, unit)
        damping = _damping(fit, stiffness, data.unit_at(joint, "N m s/rad"))
    highest = bending + settings.NORMAL_95 * std
    gap, friction = (
        EffectParameter(2.0 * fit.numbers[term][0], 2.0 * fit.numbers[term][1], angle)
        if fit.clear(term)
        else None
        for term in (SIDE, DIRECTION)
    )
    if SIDE in fit.numbers:
        side, side_std = fit.numbers[SIDE]
        most = 2.0 * (max(side, 0.0) + settings.NORMAL_95 * side_std)
    total = float(np.var(fit.twist)) or 1e-300
    return Transmission(
        joint=data.joints[joint],
        stiffness=stiffness,
        stiffness_at_least=1.0 / highest if highest > 0.0 else None,
        damping=damping,
        backlash=gap if gap is not None and gap.value > rows.resolution else None,
        backlash_at_most=most,
        lost_motion=friction,
        time_offset=EffectParameter(fit.offset, fit.offset_std, "s"),
        position_error=POSITION in fit.chosen,
        elastic_share=min(1.0, float(np.var(elastic)) / total) if stiffness is not None else 0.0,
        resolution=rows.resolution,
        rows=len(rows.load),
        unit=angle,
        reason="" if stiffness else _undecided(fit, clear=clear, exceeds_step=exceeds_step),
    )


def _undecided(fit: TwistFit, *, clear: bool, exceeds_step: bool) -> str:
    """Why no stiffness is said.

    `clear`, `exceeds_step`: whether the twist under the load differs from zero, and is larger than
    the encoders' step.
    """
    rows = fit.rows
    # Whether a twist of one step of the encoders would not have been significant.
    step = rows.resolution / max(float(np.ptp(rows.load)), 1e-300)
    hidden = step <= settings.CLEAR_DEVIATIONS * fit.numbers[LOAD][1]
    if rows.resolution > 0.0 and (LOAD in fit.chosen or hidden) and not exceeds_step:
        return (
            f"the twist under the load stays below the encoders' step of {rows.resolution:.2g}: "
            "it cannot be determined"
        )
    largest = max(float(np.abs(rows.load).max()), 1e-300)
    if float(np.std(rows.load)) <= _LEAST_VARIATION * largest:
        return "the load hardly varies: it cannot be determined"
    if LOAD in fit.chosen and not clear:
        return "what the encoders' errors and the load's leave open is as large as the twist"
    return "no twist follows the load"


def _damping(fit: TwistFit, stiffness: EffectParameter, unit: str) -> EffectParameter | None:
    """D = −K² times the coefficient of the load's rate, where it is shown."""
    rate, std = fit.numbers.get(RATE, (0.0, 0.0))
    value = -rate * stiffness.value**2
    if RATE not in fit.chosen or value <= 0.0 or stiffness.std is None:
        return None
    relative = float(np.hypot(std / rate, 2.0 * stiffness.std / stiffness.value))
    clear = settings.CLEAR_DEVIATIONS * relative < 1.0
    return EffectParameter(value, value * relative, unit) if clear else None


def _link_inertia(data: Baseline, joint: int) -> float:
    """Inertia of what is behind a joint, about it: median over the motion, kg m²."""
    inertia = np.concatenate([motion.inertia[:, joint, joint] for motion in data.motions])
    return max(float(np.median(inertia)), 1e-12)


def _without_twist(
    data: Baseline,
    joint: int,
    stiffness: float,
    damping: float | None,
    gap: float,
) -> Regression:
    """Take off what a transmission changes of the torques against a rigid one.

    `stiffness`, `gap`: N m/rad, rad. `damping`: N m s/rad; None: light, where none was measured.
    """
    if damping is None:
        damping = _LIGHT_DAMPING * 2.0 * float(np.sqrt(stiffness * _link_inertia(data, joint)))
    parts = [transmitted(motion, joint, stiffness, damping, gap) for motion in data.motions]
    joints = list(data.rows)
    for other in parts[0]:
        changed = data.decimated(other, [part[other][:, 0] for part in parts])
        joints[other] = replace(joints[other], torque=joints[other].torque - changed)
    return replace(data.regression, joints=tuple(joints))


def with_transmissions(
    data: Baseline,
    measured: Sequence[Measured],
    causes: Sequence[Cause],
    without: Collection[str] = (),
) -> tuple[list[Cause], list[Cause], list[str]]:
    """Put measured shafts and play in place of those that the torque alone suggests.

    Where both name one, it is one cause, with the measured numbers and the torque gap of the other.
    What the encoder behind a gear excludes at 95 % is taken out, with a note. Returns all causes,
    those of them that were measured, and the notes.
    """
    kept, shafts, notes = list(causes), [], []
    for transmission in measured:
        result = transmission.result
        suggested = [c for c in kept if c.joint == result.joint and part_of(c.effect) in _PARTS]
        part = _part(data, transmission)
        if part and name_of(part) not in without:
            cause = _cause(data, transmission, part)
            if suggested:
                gaps = ("torque_gap", "joint_gaps", "simulation_gap")
                cause = replace(cause, **{name: getattr(suggested[0], name) for name in gaps})
            kept = [cause, *(other for other in kept if other not in suggested)]
            shafts.append(cause)
            continue
        for cause in suggested:
            if _excluded(result, cause):
                kept.remove(cause)
                notes.append(sentences.refuted(result, cause.effect))
    return kept, shafts, notes


def _part(data: Baseline, transmission: Measured) -> Part:
    """What a measured transmission is, a shaft or play; empty where nothing matters in it."""
    result, fit = transmission.result, transmission.fit
    if fit is None:
        return ""
    stiffness = np.inf if result.stiffness is None else result.stiffness.value
    bending = float(np.max(np.abs(fit.rows.load))) / stiffness
    if result.backlash is not None and result.backlash.value > _WIDE * bending:
        return "play"
    # Of the link against a motor at rest, median over the motion.
    resonance = np.sqrt(stiffness / _link_inertia(data, transmission.joint)) / (2.0 * np.pi)
    return "" if resonance > _STIFF_RESONANCE else "shaft"


def _excluded(result: Transmission, cause: Cause) -> bool:
    """Whether the measured bounds exclude a shaft or play of that size."""
    if part_of(cause.effect) == "play":
        most = result.backlash_at_most
        return most is not None and cause.parameters["gap"].value > most
    least = result.stiffness_at_least
    return least is not None and cause.parameters["stiffness"].value < least


def _cause(data: Baseline, transmission: Measured, part: Part) -> Cause:
    """Name a measured shaft or play, with the residual of the refit at the joint as its gap.

    The transmission is not fitted to the torque; the base parameters are, without and with it.
    """
    result, fit, joint = transmission.result, transmission.fit, transmission.joint
    assert fit is not None
    stiffness, gap, damping = result.stiffness, result.backlash, result.damping
    if stiffness is None and result.stiffness_at_least is not None:
        unit = data.unit_at(joint, "N m/rad")
        stiffness = EffectParameter(result.stiffness_at_least, None, unit)
    named = {"gap": gap if part == "play" else None, "stiffness": stiffness, "damping": damping}
    parameters = {name: number for name, number in named.items() if number is not None}
    before = after = data.regression.fitted
    if stiffness is not None:
        damped = None if damping is None else damping.value
        play = gap.value if gap is not None and part == "play" else 0.0
        elastic = _without_twist(data, joint, stiffness.value, damped, play)
        after = elastic.fit(before.noise_models, steps=0)
    one, two = (rms(fitted.residuals[joint]) for fitted in (before, after))
    return Cause(
        effect=name_of(part),
        kind="structural",
        joint=result.joint,
        sentence=sentences.transmission(result, name_of(part)),
        parameters=parameters,
        evidence=fit.evidence(SIDE if part == "play" else LOAD),
        torque_gap=Gap.between(one, two),
        joint_gaps=(data.joint_change(joint, one, two),),
    )
