"""Stiffness, damping, play and time offset of every transmission with an encoder behind it."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy import stats

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
    fit_twist,
    term_columns,
    with_term,
)
from idim_iv_ros.diagnosis.transmission.twist import (
    LINK_MOTION_STEPS,
    TwistRows,
    has_encoder,
    twist_rows,
)
from idim_iv_ros.effects.two_masses import transmitted
from idim_iv_ros.identification.link_encoders import link_encoders
from idim_iv_ros.statistics.hypothesis import HypothesisTest
from idim_iv_ros.types import FloatArray

_LEAST_VARIATION = 0.01  # of the largest load: a smaller deviation shows no stiffness
_LIGHT_DAMPING = 0.03  # times critical, of a shaft where none shows

UnitAt = Callable[[str], str]

_SAME = "one compliance holds for {parts}"


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
        rows = self.fit.rows
        rest = self.fit.residual
        line = self.fit.coefficients[LOAD] * rows.load if self.fit.accepted(LOAD) else 0.0 * rest
        side = (
            self.fit.coefficients[SIDE] * rows.side
            if self.fit.accepted(SIDE)
            else np.zeros(len(rest))
        )
        return TransmissionSeries(
            joint=self.result.joint,
            load=rows.load,
            twist=line + side + rest,
            direction=rows.direction,
        )


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
    rows = twist_rows(data, regression, joint)
    reason = _unusable(data, rows, joint)
    if reason:
        return Measured(joint, Transmission(joint=data.joints[joint], reason=reason))
    fit = fit_twist(rows)
    for _ in range(LINK_MOTION_STEPS):
        compliance = fit.coefficients[LOAD]
        if not fit.accepted(LOAD) or compliance <= settings.CLEAR_DEVIATIONS * fit.stds[LOAD]:
            break
        fit = fit_twist(_with_link_motion(data, regression, joint, fit))
        if fit.accepted(SIDE):
            fit = fit_twist(fit.rows.away_from_side_changes())
    return Measured(
        joint, transmission(fit, data.joints[joint], lambda u: data.unit_at(joint, u)), fit
    )


def _with_link_motion(
    data: Baseline, regression: Regression, joint: int, fit: TwistFit
) -> TwistRows:
    """Rows with the load of links that move as the shaft lets them, refitted as such.

    A refit that takes the motor's motion for the link's finds heavier links.
    """
    compliance = fit.coefficients[LOAD]
    damping = None
    if fit.accepted(RATE) and fit.coefficients[RATE] < 0.0:
        damping = -fit.coefficients[RATE] / compliance**2
    gap = 2.0 * max(fit.coefficients[SIDE], 0.0) if fit.accepted(SIDE) else 0.0
    columns = twist_torques(data, joint, 1.0 / compliance, damping, gap)
    rigid = regression.fit()
    elastic = less(regression, columns).fit(rigid.noise_models)
    return twist_rows(data, regression, joint, compliance, elastic.values)


def _unusable(data: Baseline, rows: TwistRows, joint: int) -> str:
    """Say why nothing can be measured; empty where something can."""
    if len(rows.load) < settings.LEAST_ROWS:
        return (
            f"only {len(rows.load)} rows of the encoder behind the gear count: record for longer, "
            "with this joint moving"
        )
    types = data.prepared.model.robot.joint_types
    for link_encoder in link_encoders(data.prepared.motions, data.joints, types):
        if link_encoder.joint == data.joints[joint]:
            return link_encoder.problem
    return ""


def transmission(fit: TwistFit, joint: str, unit_at: UnitAt = str) -> Transmission:
    """Everything that the twist says, with what makes it unsure.

    Parameters
    ----------
    unit_at
        From a unit of a joint that turns to that of this one.
    """
    rows, terms = fit.rows, fit.terms
    compliance, std, test = _compliance(fit)
    elastic = compliance * rows.load
    sure = compliance > settings.CLEAR_DEVIATIONS * std
    large = float(np.ptp(elastic)) > rows.resolution
    stiffness = damping = None
    if fit.accepted(LOAD) and sure and large:
        stiffness = EffectParameter(1.0 / compliance, std / compliance**2, unit_at("N m/rad"))
        damping = _damping(fit, stiffness, unit_at)
    highest = compliance + settings.NORMAL_95 * std
    gap = _twice(fit, SIDE, unit_at)
    total = float(np.var(fit.twist)) or 1e-300
    share = float(np.var(elastic)) / total
    return Transmission(
        joint=joint,
        stiffness=stiffness,
        stiffness_at_least=1.0 / highest if highest > 0.0 else None,
        damping=damping,
        backlash=gap if gap is not None and gap.value > rows.resolution else None,
        backlash_at_most=_most_backlash(fit),
        lost_motion=_twice(fit, DIRECTION, unit_at),
        time_offset=EffectParameter(fit.offset, fit.offset_std, "s"),
        position_error=POSITION in terms,
        explained=max(0.0, 1.0 - float(np.var(fit.residual)) / total),
        elastic_share=min(1.0, share) if stiffness is not None else 0.0,
        twist_rms=float(np.sqrt(total)),
        resolution=rows.resolution,
        rows=len(rows.load),
        tests=(test,),
        unit=unit_at("rad"),
        reason=_undecided(fit, sure=sure, large=large, measured=stiffness is not None),
    )


def _undecided(fit: TwistFit, *, sure: bool, large: bool, measured: bool) -> str:
    """Why no stiffness is said; empty where one is."""
    if measured:
        return ""
    rows = fit.rows
    if rows.resolution > 0.0 and (fit.accepted(LOAD) or not _could_be_seen(fit)) and not large:
        return (
            f"the twist under the load stays below the encoders' step of {rows.resolution:.2g}: "
            "it cannot be determined"
        )
    largest = max(float(np.abs(rows.load).max()), 1e-300)
    if float(np.std(rows.load)) <= _LEAST_VARIATION * largest:
        return "the load hardly varies: it cannot be determined"
    if fit.accepted(LOAD) and not sure:
        return "what the encoders' errors and the load's leave open is as large as the twist"
    return "no twist follows the load"


def _could_be_seen(fit: TwistFit) -> bool:
    """Whether a twist of one step of the encoders would have been significant."""
    step = fit.rows.resolution / max(float(np.ptp(fit.rows.load)), 1e-300)
    return step > settings.CLEAR_DEVIATIONS * fit.stds[LOAD]


def _compliance(fit: TwistFit) -> tuple[float, float, HypothesisTest]:
    """1/K, its standard deviation (rad/(N m)), and whether all parts of the recording agree.

    The deviation holds the noise of the twist, the parameters of the links, an error over the
    position that the twist allows and does not ask for, and by how much the parts of the
    recording differ beyond noise (Birge's ratio).
    """
    value, noise = fit.coefficients[LOAD], fit.stds[LOAD]
    test, ratio = _agreement(fit)
    variance = noise**2 * max(1.0, ratio) + _load_variance(fit)
    if POSITION not in fit.terms and fit.accepted(LOAD):
        beside = with_term(fit, term_columns(fit.rows)[POSITION])
        place = fit.terms.index(LOAD)
        variance += (float(beside.coefficients[place]) - value) ** 2
    return value, float(np.sqrt(variance)), test


def _load_variance(fit: TwistFit) -> float:
    """Variance of 1/K from the parameters of the links: its gradient along each of them."""
    rows = fit.rows
    noise = fit.fit.noise_models[0]
    segments = rows.segments
    others = [fit.regression.joints[0].matrix]
    columns = term_columns(rows)
    others += [columns[term] for term in fit.terms if term != LOAD]
    whiten = noise.standardized
    nuisance = np.linalg.qr(whiten(np.column_stack(others), segments))[0]

    def rest(values: FloatArray) -> FloatArray:
        white = whiten(values, segments)
        return white - nuisance @ (nuisance.T @ white)

    load, changes = rest(rows.load), rest(rows.load_columns)
    twist = rest(fit.regression.joints[0].torque)
    energy = float(load @ load)
    if energy <= 0.0:
        return 0.0
    value = float(load @ twist) / energy
    gradient = (changes.T @ twist - 2.0 * value * (changes.T @ load)) / energy
    return float(np.maximum(gradient @ rows.load_covariance @ gradient, 0.0))


def _agreement(fit: TwistFit) -> tuple[HypothesisTest, float]:
    """H0: one compliance for every recording (of one, for both halves); χ² over its df."""
    rows = fit.rows
    part = rows.recording
    words = _SAME.format(parts="all recordings")
    if len(np.unique(part)) < 2:
        part = (np.arange(len(part)) >= len(part) // 2).astype(np.int64)
        words = _SAME.format(parts="both halves of the recording")
    labels = np.unique(part)
    blocks = rows.load[:, None] * (part[:, None] == labels[1:])
    found = with_term(fit, blocks)
    if not fit.accepted(LOAD):
        reason = "no twist follows the load"
        return HypothesisTest.not_run(words, "all", reason), 1.0
    own = slice(len(found.coefficients) - blocks.shape[1], None)
    change, covariance = found.coefficients[own], found.coefficient_covariance[own, own]
    df = int(np.linalg.matrix_rank(covariance))
    if df == 0:
        return HypothesisTest.not_run(words, "all", "the load moves in one part only"), 1.0
    statistic = float(change @ np.linalg.pinv(covariance) @ change)
    test = HypothesisTest(
        words, "all", statistic, df, None, float(stats.chi2.sf(statistic, df)), alpha=0.01
    )
    return test, statistic / df


def _damping(fit: TwistFit, stiffness: EffectParameter, unit_at: UnitAt) -> EffectParameter | None:
    """D = −K² times the coefficient of the load's rate, where it is shown."""
    if not fit.accepted(RATE):
        return None
    value = -fit.coefficients[RATE] * stiffness.value**2
    assert stiffness.std is not None
    relative = np.hypot(
        fit.stds[RATE] / fit.coefficients[RATE], 2.0 * stiffness.std / stiffness.value
    )
    std = float(abs(value) * relative)
    if value <= settings.CLEAR_DEVIATIONS * std:
        return None
    return EffectParameter(value, std, unit_at("N m s/rad"))


def _twice(fit: TwistFit, term: str, unit_at: UnitAt) -> EffectParameter | None:
    """Whole width of what changes sides with a term."""
    if not fit.accepted(term):
        return None
    value, std = 2.0 * fit.coefficients[term], 2.0 * fit.stds[term]
    if value <= settings.CLEAR_DEVIATIONS * std:
        return None
    return EffectParameter(value, std, unit_at("rad"))


def _most_backlash(fit: TwistFit) -> float | None:
    """Upper end of the gap's 95 % interval, rad; None where the load never changes its side."""
    if SIDE not in fit.coefficients:
        return None
    return 2.0 * (max(fit.coefficients[SIDE], 0.0) + settings.NORMAL_95 * fit.stds[SIDE])


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
