"""Stiffness, damping, play and time offset of every transmission with an encoder behind it."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.likelihood import Columns, Regression
from idim_iv_ros.diagnosis.refit.baseline import Baseline
from idim_iv_ros.diagnosis.result import EffectParameter, Transmission, TransmissionSeries
from idim_iv_ros.diagnosis.transmission.fit import (
    DIRECTION,
    LOAD,
    POSITION,
    RATE,
    SIDE,
    TwistFit,
    compliance,
    fit_twist,
)
from idim_iv_ros.diagnosis.transmission.twist import (
    LINK_MOTION_STEPS,
    TwistRows,
    has_encoder,
    twist_rows,
)
from idim_iv_ros.effects.two_masses import transmitted
from idim_iv_ros.identification.link_encoders import link_encoders

_LEAST_VARIATION = 0.01  # of the largest load: a smaller deviation shows no stiffness
_LIGHT_DAMPING = 0.03  # times critical, of a shaft where none shows


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


def measured_transmissions(data: Baseline, regression: Regression) -> tuple[Measured, ...]:
    """Measure every joint that has an encoder behind its gear.

    Parameters
    ----------
    regression
        Of the refit on the smooth motion.
    """
    joints = [joint for joint in range(len(data.joints)) if has_encoder(data, joint)]
    return tuple(_measured(data, regression, joint) for joint in joints)


def _measured(data: Baseline, regression: Regression, joint: int) -> Measured:
    rows, name = twist_rows(data, regression, joint), data.joints[joint]
    reason = _unusable(data, rows, joint)
    if reason:
        return Measured(joint, Transmission(joint=name, reason=reason))
    fit = fit_twist(rows)
    for _ in range(LINK_MOTION_STEPS):
        if not fit.clear(LOAD):
            break
        fit = fit_twist(_with_link_motion(data, regression, joint, fit))
        if SIDE in fit.terms:
            fit = fit_twist(fit.rows.away_from_side_changes())
    return Measured(joint, transmission(fit, name, lambda unit: data.unit_at(joint, unit)), fit)


def _with_link_motion(
    data: Baseline, regression: Regression, joint: int, fit: TwistFit
) -> TwistRows:
    """Rows with the load of links that move as the shaft lets them, refitted as such.

    A refit that takes the motor's motion for the link's finds heavier links.
    """
    bending, rate = fit.accepted(LOAD), fit.accepted(RATE)
    damping = -rate / bending**2 if rate < 0.0 else None
    gap = 2.0 * max(fit.accepted(SIDE), 0.0)
    columns = twist_torques(data, joint, 1.0 / bending, damping, gap)
    elastic = less(regression, columns).fit(regression.fit().noise_models)
    return twist_rows(data, regression, joint, bending, elastic.values)


def _unusable(data: Baseline, rows: TwistRows, joint: int) -> str:
    """Say why nothing can be measured; empty where something can."""
    if len(rows.load) < settings.LEAST_ROWS:
        return (
            f"only {len(rows.load)} rows of the encoder behind the gear count: record for longer, "
            "with this joint moving"
        )
    types = data.prepared.model.robot.joint_types
    encoders = link_encoders(data.prepared.motions, data.joints, types)
    return next((each.problem for each in encoders if each.joint == data.joints[joint]), "")


def transmission(fit: TwistFit, joint: str, unit_at: Callable[[str], str] = str) -> Transmission:
    """Everything that the twist says, with what makes it unsure.

    Parameters
    ----------
    unit_at
        From a unit of a joint that turns to that of this one.
    """
    rows = fit.rows
    bending, std, test = compliance(fit)
    elastic = bending * rows.load
    clear = bending > settings.CLEAR_DEVIATIONS * std
    above_step = float(np.ptp(elastic)) > rows.resolution
    stiffness = damping = None
    if LOAD in fit.terms and clear and above_step:
        stiffness = EffectParameter(1.0 / bending, std / bending**2, unit_at("N m/rad"))
        damping = _damping(fit, stiffness, unit_at("N m s/rad"))
    highest = bending + settings.NORMAL_95 * std
    gap, friction = (
        EffectParameter(2.0 * fit.numbers[term][0], 2.0 * fit.numbers[term][1], unit_at("rad"))
        if fit.clear(term)
        else None
        for term in (SIDE, DIRECTION)
    )
    most = None
    if SIDE in fit.numbers:
        side, side_std = fit.numbers[SIDE]
        most = 2.0 * (max(side, 0.0) + settings.NORMAL_95 * side_std)
    total = float(np.var(fit.twist)) or 1e-300
    return Transmission(
        joint=joint,
        stiffness=stiffness,
        stiffness_at_least=1.0 / highest if highest > 0.0 else None,
        damping=damping,
        backlash=gap if gap is not None and gap.value > rows.resolution else None,
        backlash_at_most=most,
        lost_motion=friction,
        time_offset=EffectParameter(fit.offset, fit.offset_std, "s"),
        position_error=POSITION in fit.terms,
        explained=max(0.0, 1.0 - float(np.var(fit.fit.residuals[0])) / total),
        elastic_share=min(1.0, float(np.var(elastic)) / total) if stiffness is not None else 0.0,
        twist_rms=float(np.sqrt(total)),
        resolution=rows.resolution,
        rows=len(rows.load),
        tests=(test,),
        unit=unit_at("rad"),
        reason="" if stiffness else _undecided(fit, clear=clear, above_step=above_step),
    )


def _undecided(fit: TwistFit, *, clear: bool, above_step: bool) -> str:
    """Why no stiffness is said.

    Parameters
    ----------
    clear, above_step
        Whether the twist under the load differs from zero, and is larger than the encoders' step.
    """
    rows = fit.rows
    # Whether a twist of one step of the encoders would not have been significant.
    step = rows.resolution / max(float(np.ptp(rows.load)), 1e-300)
    hidden = step <= settings.CLEAR_DEVIATIONS * fit.numbers[LOAD][1]
    if rows.resolution > 0.0 and (LOAD in fit.terms or hidden) and not above_step:
        return (
            f"the twist under the load stays below the encoders' step of {rows.resolution:.2g}: "
            "it cannot be determined"
        )
    largest = max(float(np.abs(rows.load).max()), 1e-300)
    if float(np.std(rows.load)) <= _LEAST_VARIATION * largest:
        return "the load hardly varies: it cannot be determined"
    if LOAD in fit.terms and not clear:
        return "what the encoders' errors and the load's leave open is as large as the twist"
    return "no twist follows the load"


def _damping(fit: TwistFit, stiffness: EffectParameter, unit: str) -> EffectParameter | None:
    """D = −K² times the coefficient of the load's rate, where it is shown."""
    rate, std = fit.numbers.get(RATE, (0.0, 0.0))
    value = -rate * stiffness.value**2
    if RATE not in fit.terms or value <= 0.0 or stiffness.std is None:
        return None
    relative = float(np.hypot(std / rate, 2.0 * stiffness.std / stiffness.value))
    clear = settings.CLEAR_DEVIATIONS * relative < 1.0
    return EffectParameter(value, value * relative, unit) if clear else None


def link_inertia(data: Baseline, joint: int) -> float:
    """Inertia of what is behind a joint, about it: median over the motion, kg m²."""
    inertia = np.concatenate([motion.inertia[:, joint, joint] for motion in data.motions])
    return max(float(np.median(inertia)), 1e-12)


def twist_torques(
    data: Baseline, joint: int, stiffness: float, damping: float | None, gap: float
) -> Columns:
    """Change of all torques against a rigid transmission, (r, 1) by joint.

    Parameters
    ----------
    stiffness, gap
        N m/rad, rad.
    damping
        N m s/rad; None: light, where none was measured.
    """
    if damping is None:
        critical = 2.0 * float(np.sqrt(stiffness * link_inertia(data, joint)))
        damping = _LIGHT_DAMPING * critical
    parts = [transmitted(motion, joint, stiffness, damping, gap) for motion in data.motions]
    pairs = list(zip(data.motions, parts, strict=True))
    return {
        other: data.counting(other, [motion.rows(part[other]) for motion, part in pairs])
        for other in parts[0]
    }


def less(regression: Regression, columns: Columns) -> Regression:
    """Return the same rows with a known torque (r, 1) taken off."""
    joints = tuple(
        replace(rows, torque=rows.torque - columns[joint][:, 0]) if joint in columns else rows
        for joint, rows in enumerate(regression.joints)
    )
    return Regression(joints, regression.parameters)
