"""The result of a diagnosis from what its steps found: order of the causes, verdict, notes."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from importlib import metadata

import numpy as np

from idim_iv_ros.configuration import Configuration
from idim_iv_ros.diagnosis import sentences, settings
from idim_iv_ros.diagnosis.answer.explained import Explained
from idim_iv_ros.diagnosis.answer.named_model import NamedModel, matters
from idim_iv_ros.diagnosis.answer.parameter_errors import (
    NumberErrors,
    parameter_errors,
    remaining,
)
from idim_iv_ros.diagnosis.controller.check import LawCheck, why_not_checked
from idim_iv_ros.diagnosis.refit.baseline import Baseline, nominal_residuals
from idim_iv_ros.diagnosis.refit.refit import Refit
from idim_iv_ros.diagnosis.refit.soft_friction import LEAST_LEAD
from idim_iv_ros.diagnosis.result import (
    Cause,
    EffectParameter,
    GapResult,
    GapSeries,
    Hint,
    NotTestable,
    RecordingAgreement,
    Stage,
    Unexplained,
    Verdict,
    Where,
)
from idim_iv_ros.diagnosis.tracking import Tracking, tracking_series, with_tracking
from idim_iv_ros.diagnosis.transmission.causes import described, measured_behind
from idim_iv_ros.diagnosis.transmission.measure import Measured
from idim_iv_ros.diagnosis.unexplained import (
    unexplained,
    unexplained_residual,
)
from idim_iv_ros.diagnosis.where import Finding, motion_at_rows
from idim_iv_ros.effects.registry import BY_NAME
from idim_iv_ros.identification.identify import consistent_parameters
from idim_iv_ros.identification.prepare import ARMATURE_MISSING
from idim_iv_ros.model import kinematics_digest
from idim_iv_ros.physical import PhysicalParameters
from idim_iv_ros.types import FloatArray

_REPORTED = ("idim-iv-ros", "numpy", "scipy", "pin", "numba", "rosbags")


def strongest_first(causes: Sequence[Cause], data: Baseline) -> list[Cause]:
    """Sort causes by what they take of the gap, as a share of the torque of the joint.

    Of causes that move several joints the shares of all count. Another control law has no gap of
    the torque: its evidence decides whether it comes before the structural causes or after them.
    What was put in before anything else was looked for comes first: drive inertia that the
    configuration leaves out, and a delay of all joints.
    """
    laws = [cause for cause in causes if BY_NAME[cause.effect].part == "gains"]
    others = [cause for cause in causes if BY_NAME[cause.effect].part != "gains"]
    others.sort(key=lambda cause: -_taken(cause, data))
    structural = [place for place, cause in enumerate(others) if cause.kind == "structural"]
    place = structural[-1] + 1 if structural else len(others)
    if structural and _most_evidence(laws) > _most_evidence([others[each] for each in structural]):
        place = structural[0]
    ordered = [*others[:place], *laws, *others[place:]]
    return sorted(ordered, key=lambda cause: not _put_in_first(cause))


def _put_in_first(cause: Cause) -> bool:
    return BY_NAME[cause.effect].put_in_first and cause.joint is None


def _most_evidence(group: Sequence[Cause]) -> float:
    return max((cause.evidence.statistic for cause in group), default=0.0)


def _taken(cause: Cause, data: Baseline) -> float:
    """Energy of the torque gap that a cause takes, as a share of the torque's, over its joints."""
    if cause.joint_gaps:
        return sum(
            float(np.sign(joint_gap.share_of_torque)) * joint_gap.share_of_torque**2
            for joint_gap in cause.joint_gaps
        )
    taken = cause.torque_gap.before**2 - cause.torque_gap.after**2
    joints = range(len(data.joints)) if cause.joint is None else [data.joints.index(cause.joint)]
    whole = sum(float(np.mean(data.rows[joint].torque ** 2)) for joint in joints)
    return taken / max(whole, 1e-300)


def verdict_of(
    causes: Sequence[Cause],
    outside: Unexplained | None,
    *,
    parameters: bool = False,
    unexplained: bool = False,
) -> Verdict:
    """One word: causes of the catalogue count before what is outside it.

    Parameters
    ----------
    parameters
        Whether parameters are in error beyond the causes: it is not known which.
    unexplained
        Whether much of the gap remains.
    """
    kinds: set[str] = {cause.kind for cause in causes}
    if parameters and not kinds and not unexplained:
        kinds = {"parametric"}
    if kinds == {"parametric", "structural"}:
        return "both"
    if "parametric" in kinds:
        return "parametric" if outside is None else "unknown"
    if "structural" in kinds:
        return "structural"
    return "unknown" if unexplained or outside is not None else "none"


@dataclass(frozen=True)
class Diagnosis:
    """What the steps of a diagnosis found.

    Attributes
    ----------
    configuration : Configuration
    without : tuple of str
        Effects that were left out of the catalogue.
    refit : Refit
    explained : Explained
    errors : NumberErrors
    tracked : sequence of Tracking
        Simulated motion of every stage.
    causes : sequence of Cause
    hints : tuple of Hint
        What the search selected and what is no cause.
    law : LawCheck
    recordings : tuple of RecordingAgreement
        One for each of several.
    where : Where
    findings : tuple of Finding
        Regimes in which much of the gap lies.
    not_testable : tuple of NotTestable
    transmissions : tuple of Measured
    excluded : sequence of str
        What encoders behind the gears exclude.
    """

    configuration: Configuration
    without: tuple[str, ...]
    refit: Refit
    explained: Explained
    errors: NumberErrors
    tracked: Sequence[Tracking]
    causes: Sequence[Cause]
    hints: tuple[Hint, ...]
    law: LawCheck
    recordings: tuple[RecordingAgreement, ...]
    where: Where
    findings: tuple[Finding, ...]
    not_testable: tuple[NotTestable, ...]
    transmissions: tuple[Measured, ...]
    excluded: Sequence[str]


def assembled(found: Diagnosis) -> GapResult:
    """Build the result."""
    refit, model = found.refit, found.explained.model
    data, law = refit.data, found.law
    left_out = data.left_out
    causes = strongest_first(found.causes, data)
    outside = unexplained(data, model, found.explained.floors)
    session = data.prepared.session.parts
    physical, why_not = _consistent(refit, model)
    errors = parameter_errors(data, found.errors)
    not_named = remaining(errors)
    stages = with_tracking(found.explained.tested.stages(), found.tracked)
    residual = unexplained_residual(data, model, stages, found.explained.floors)
    small = [] if causes else remaining(errors, settings.PARAMETRIC_LEAST_TORQUE)
    nothing_shown = len(left_out) == len(data.joints)
    verdict = verdict_of(
        causes, outside, parameters=bool(not_named), unexplained=bool(residual) or nothing_shown
    )
    differing = [recording for recording in found.recordings if not recording.agrees]
    gaps = [gap for gap in found.where.joints if data.joints.index(gap.joint) not in left_out]
    summary = [
        sentences.disagreement(differing),
        sentences.largest_gap(gaps, "refit" if data.prepared.given is None else "nominal model"),
        sentences.nothing_explains(remaining=bool(not_named or small)) if verdict == "none" else "",
        causes[0].sentence if causes else "",
        sentences.further_causes(causes[1:]),
        sentences.not_in_catalogue(outside),
        sentences.unexplained_residual(data, residual),
        sentences.remaining_parameter_errors(data, not_named or small, found.hints),
        sentences.next_step(
            causes, unknown=verdict == "unknown", remaining=bool(not_named or small)
        ),
        sentences.left_out(data),
        *law.beyond,
        *(cause.sentence for cause in causes[1:] if measured_behind(cause)),
        f"left out of the catalogue on request: {', '.join(found.without)}" * bool(found.without),
        ARMATURE_MISSING * data.prepared.armature_missing,
    ]
    named = {(cause.effect, cause.joint) for cause in causes}
    first, last = (found.tracked[0], found.tracked[-1]) if found.tracked else (None, None)
    speed = None if law.speed is None else law.speed.words
    return GapResult(
        robot=data.prepared.model.robot.name,
        joints=data.joints,
        joint_types=data.prepared.model.robot.joint_types,
        bags=tuple(part.bag for part in session),
        session=session,
        software={name: metadata.version(name) for name in _REPORTED},
        configuration=found.configuration.model_dump(mode="json", exclude_none=True),
        without=found.without,
        verdict=verdict,
        summary=sentences.summary(summary),
        causes=tuple(causes),
        hints=found.hints,
        unexplained=outside,
        where=found.where,
        findings=tuple(sentences.finding(finding, session) for finding in found.findings),
        not_testable=tuple(
            effect for effect in found.not_testable if (effect.effect, effect.joint) not in named
        ),
        stages=_with_weightless(refit, stages),
        series=_series(refit, model),
        tracking=tracking_series(data, first, last),
        notes=_notes(found, speed),
        extended_parameters=_extended_parameters(refit, model),
        physical=physical,
        why_no_physical=why_not,
        kinematics=kinematics_digest(data.prepared.model.robot),
        parameter_errors=errors,
        signal_chain=refit.shift.part_of_result(data.joints, speed),
        friction_leads={}
        if refit.softened is None
        else {
            name: float(lead)
            for name, lead in zip(data.joints, refit.softened.leads, strict=True)
            if lead > LEAST_LEAD
        },
        recordings=found.recordings,
        transmissions=tuple(transmission.result for transmission in found.transmissions),
        twists=tuple(
            transmission.series
            for transmission in found.transmissions
            if transmission.series is not None
        ),
    )


def _with_weightless(refit: Refit, stages: tuple[Stage, ...]) -> tuple[Stage, ...]:
    """Put the nominal model without gravity first where gravity was missing."""
    if refit.weightless is None:
        return stages
    return (
        refit.weightless.stage(0),
        replace(stages[0], name="+gravity_direction"),
        *stages[1:],
    )


def _series(refit: Refit, model: NamedModel) -> tuple[GapSeries, ...]:
    """Measured torque and that of three models for the figures, one series for each joint."""
    data, regression = refit.data, refit.regression
    residuals, given = nominal_residuals(data, regression), data.prepared.given
    made = []
    for joint, name in enumerate(data.joints):
        torque = regression.joints[joint].torque
        motion = motion_at_rows(data, joint)
        made.append(
            GapSeries(
                joint=name,
                time=motion.time,
                torque=torque,
                given=None if residuals is None else torque - residuals[joint],
                refit=torque - model.fits[0].residuals[joint],
                extended=torque - model.fit.residuals[joint],
                friction=_friction(refit, joint, model.fit.values)
                + _friction_of_effects(model, joint),
                given_friction=None if given is None else _friction(refit, joint, given),
                position=motion.position,
                speed=motion.velocity,
                load=motion.load,
                since_reversal=motion.since_reversal,
                step=1.0 / data.row_rate,
            )
        )
    return tuple(made)


def _friction(refit: Refit, joint: int, values: FloatArray) -> FloatArray:
    """Friction and offset (r,) of one joint with base parameters (b,), N m (N)."""
    rows, names = refit.regression.joints[joint], refit.data.prepared.model.base.names
    own = {f"{kind}{joint + 1}" for kind in ("Fv", "Fc", "off")}
    chosen = [place for place, column in enumerate(rows.columns) if names[column] in own]
    return np.asarray(rows.matrix[:, chosen] @ values[rows.columns[chosen]])


def _friction_of_effects(model: NamedModel, joint: int) -> FloatArray:
    """Friction (r,) of one joint that effects of the extended model add, N m (N)."""
    friction, start = np.zeros(len(model.fit.residuals[joint])), 0
    for term in model.effects:
        coefficients = model.fit.coefficients[start : start + term.width]
        start += term.width
        if term.effect.part == "friction" and joint in term.columns:
            friction += term.columns[joint] @ coefficients
    return friction


def _notes(found: Diagnosis, law_speed: str | None) -> tuple[str, ...]:
    """What could not be done and why, each once."""
    data, tested, softened = found.refit.data, found.explained.tested, found.refit.softened
    prepared = data.prepared
    notes = [
        found.refit.shift.sentence(data.joints),
        *(ripple.sentence(data.joints) for ripple in found.refit.ripples),
        softened and softened.sentence(data.joints),
        law_speed and f"the speed in the control law: {law_speed}",
        *(described(transmission.result) for transmission in found.transmissions),
        *found.excluded,
        tested.note and f"held-out gaps: {tested.note}",
        *(floor.note and f"noise floor: {floor.note}" for floor in found.explained.floors),
    ]
    seconds = sum(recording.duration for recording in prepared.recordings)
    if seconds < settings.SHORT_RECORDING:
        notes.append(
            f"only {seconds:.3g} s were recorded: effects may pass for one another, or for noise; "
            "record a minute or more"
        )
    unchecked = why_not_checked(data)
    notes += [
        *found.law.beyond,
        *(
            f"{data.joints[joint_finding.joint]} is left out: {joint_finding.sentence}"
            for joint_finding in prepared.joint_findings
            if joint_finding.left_out
        ),
        ARMATURE_MISSING * prepared.armature_missing,
        prepared.why_no_given,
        *data.sources.controller,
        unchecked and f"commands not compared with the control law: {unchecked}",
        *(tracked.note or tracked.caveat for tracked in found.tracked),
        *prepared.warnings,
        *prepared.advice,
        *prepared.reasons,
        *(
            sentences.small_nonparametric(data, effect)
            for effect in found.explained.model.outside
            if not matters(effect)
        ),
    ]
    return tuple(dict.fromkeys(note for note in notes if note))


def _consistent(refit: Refit, model: NamedModel) -> tuple[PhysicalParameters | None, str]:
    """Physical parameters nearest to the extended model, judged on torques without its effects."""
    fit, parameters = model.fit, len(model.fit.values)
    rows = [
        replace(joint, torque=joint.prediction(fit.values) + residual)
        for joint, residual in zip(refit.regression.joints, fit.residuals, strict=True)
    ]
    sigma = np.array([max(float(np.std(residual)), 1e-300) for residual in fit.residuals])
    covariance = fit.covariance[:parameters, :parameters]
    # Effects of friction share their joint's Fv and Fc: only the sum is friction.
    friction = [effect for effect in model.effects if effect.effect.part == "friction"]
    joints = {joint for term in friction for joint in term.columns}
    shared = [f"{kind}{joint + 1}" for joint in sorted(joints) for kind in ("Fv", "Fc")]
    return consistent_parameters(refit.data.prepared, fit.values, covariance, rows, sigma, shared)


def _extended_parameters(refit: Refit, model: NamedModel) -> dict[str, EffectParameter]:
    base = refit.data.prepared.model.base
    deviations = np.sqrt(np.maximum(np.diag(model.fit.covariance), 0.0))
    return {
        name: EffectParameter(float(model.fit.values[k]), float(deviations[k]), base.units[k])
        for k, name in enumerate(base.names)
    }
