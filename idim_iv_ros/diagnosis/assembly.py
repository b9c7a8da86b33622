"""The document of a diagnosis: the steps after the search, the verdict, what is said of it."""

from collections.abc import Sequence
from dataclasses import replace
from importlib import metadata

import numpy as np

from idim_iv_ros.configuration import Configuration
from idim_iv_ros.diagnosis import sentences, settings
from idim_iv_ros.diagnosis.against.changes import agreement
from idim_iv_ros.diagnosis.answer.causes import (
    hints_of,
    parametric_causes,
    remaining,
    signal_notes,
    strongest_first,
    structural_causes,
    verdict_of,
)
from idim_iv_ros.diagnosis.answer.explained import Explained, matters
from idim_iv_ros.diagnosis.controller import check_law, why_not_checked
from idim_iv_ros.diagnosis.identifiability import not_shown_by_motion
from idim_iv_ros.diagnosis.refit.baseline import nominal_residuals
from idim_iv_ros.diagnosis.refit.refit import Refit
from idim_iv_ros.diagnosis.refit.soft_friction import LEAST_LEAD
from idim_iv_ros.diagnosis.result import EffectParameter, GapResult, GapSeries
from idim_iv_ros.diagnosis.tracking import (
    simulation_gaps,
    tracked_stages,
    tracking_series,
    with_tracking,
)
from idim_iv_ros.diagnosis.transmission.measure import measured_transmissions, with_transmissions
from idim_iv_ros.diagnosis.unexplained import (
    unexplained,
    unexplained_residual,
)
from idim_iv_ros.diagnosis.where import motion_at_rows, where
from idim_iv_ros.effects.registry import STRUCTURAL, name_of
from idim_iv_ros.identification.identify import consistent_parameters
from idim_iv_ros.identification.prepare import ARMATURE_MISSING
from idim_iv_ros.model import kinematics_digest
from idim_iv_ros.physical import PhysicalParameters
from idim_iv_ros.progress import Stopwatch
from idim_iv_ros.types import FloatArray

_REPORTED = ("idim-iv-ros", "numpy", "scipy", "pin", "numba", "rosbags")


def concluded(
    refit: Refit,
    explanation: Explained,
    configuration: Configuration,
    without: tuple[str, ...],
    watch: Stopwatch,
) -> GapResult:
    """Take the steps after the search and build the document.

    Parameters
    ----------
    refit, explanation
        What was searched, and what explains it.
    configuration
        As the user gave it.
    without
        Effects that are left out of the catalogue.
    """
    data, regression = refit.data, refit.regression
    prepared, left_out = data.prepared, data.left_out

    watch.stage("simulated motion", 0.85)
    tracked = tracked_stages(data, explanation)
    stages = with_tracking(explanation.tested.stages(), tracked)

    effects = [effect.term for effect in explanation.effects]
    recordings = agreement(data, regression, effects, without)
    numbers, errors = parametric_causes(data, explanation)
    law = check_law(data, without, shift=refit.shift.shift).not_shown_by_torque(
        data, numbers, effects
    )
    causes = [
        *structural_causes(data, explanation, simulation_gaps(explanation, tracked)),
        *numbers,
        *law.causes,
        *refit.gravity_causes(explanation.tested),
        *(refit.delays or law.delay),
    ]
    transmissions = measured_transmissions(data, regression)
    causes, shafts, excluded = with_transmissions(data, regression, transmissions, causes, without)
    causes = strongest_first(causes, data)
    hints = hints_of(data, explanation)

    watch.stage("where", 0.95)
    gaps, findings = where(data, regression, explanation.fits[0], explanation.floors)
    structural = [effect for effect in STRUCTURAL if effect.name not in without]
    not_testable = (
        *not_shown_by_motion(data, regression, structural, explanation.noise_of_refit()),
        *refit.not_testable,
    )

    outside = unexplained(data, explanation)
    residual = unexplained_residual(data, explanation, stages)
    not_named = remaining(errors, settings.LEAST_PARAMETER_ERROR)
    small = not_named if causes else remaining(errors, settings.PARAMETRIC_LEAST_TORQUE)
    nothing_shown = len(left_out) == len(data.joints)
    verdict = verdict_of(
        causes, outside, parameters=bool(not_named), unexplained=bool(residual) or nothing_shown
    )
    summary = [
        sentences.disagreement([recording for recording in recordings if not recording.agrees]),
        sentences.largest_gap(
            [gap for gap in gaps.joints if data.joints.index(gap.joint) not in left_out],
            "refit" if prepared.given is None else "nominal model",
        ),
        sentences.nothing_explains(remaining=bool(not_named or small)) if verdict == "none" else "",
        causes[0].sentence if causes else "",
        sentences.further_causes(causes[1:]),
        sentences.not_in_catalogue(outside),
        sentences.unexplained_residual(data, residual),
        sentences.remaining_parameter_errors(data, not_named or small, hints),
        sentences.next_step(
            causes, unknown=verdict == "unknown", remaining=bool(not_named or small)
        ),
        sentences.left_out(data),
        *law.beyond,
        *(cause.sentence for cause in causes[1:] if cause in shafts),
        f"left out of the catalogue on request: {', '.join(without)}" * bool(without),
        ARMATURE_MISSING * prepared.armature_missing,
    ]
    named = {(cause.effect, cause.joint) for cause in causes}
    speed = None if law.speed is None else law.speed.words
    physical, why_not = _consistent(refit, explanation)
    base, deviations = (
        prepared.model.base,
        np.sqrt(np.maximum(np.diag(explanation.fit.covariance), 0.0)),
    )
    notes = [
        refit.shift.sentence(data.joints),
        *signal_notes(data.joints, explanation.selection.terms),
        refit.softened and refit.softened.sentence(data.joints),
        speed and f"the speed in the control law: {speed}",
        *(sentences.transmission(measured.result) for measured in transmissions),
        *excluded,
        *_notes(refit, explanation, law.beyond),
        *(tracking.note or tracking.caveat for tracking in tracked),
        *prepared.warnings,
        *prepared.advice,
        *prepared.reasons,
        *(sentences.small_nonparametric(data, t) for t in explanation.outside if not matters(t)),
    ]
    if refit.weightless is not None:
        with_gravity = replace(stages[0], name=f"+{name_of('gravity')}")
        stages = (refit.weightless, with_gravity, *stages[1:])
    return GapResult(
        robot=prepared.model.robot.name,
        joints=data.joints,
        joint_types=prepared.model.robot.joint_types,
        bags=tuple(part.bag for part in prepared.session.parts),
        session=prepared.session.parts,
        software={name: metadata.version(name) for name in _REPORTED},
        configuration=configuration.model_dump(mode="json", exclude_none=True),
        without=without,
        verdict=verdict,
        summary=sentences.summary(summary),
        causes=tuple(causes),
        hints=hints,
        unexplained=outside,
        where=gaps,
        findings=tuple(sentences.finding(finding, prepared.session.parts) for finding in findings),
        not_testable=tuple(
            effect for effect in not_testable if (effect.effect, effect.joint) not in named
        ),
        stages=stages,
        series=_series(refit, explanation),
        tracking=tracking_series(data, tracked[0], tracked[-1]),
        notes=tuple(dict.fromkeys(note for note in notes if note)),
        extended_parameters={
            name: EffectParameter(
                float(explanation.fit.values[k]), float(deviations[k]), base.units[k]
            )
            for k, name in enumerate(base.names)
        },
        physical=physical,
        why_no_physical=why_not,
        kinematics=kinematics_digest(prepared.model.robot),
        parameter_errors=errors,
        signal_chain=refit.shift.part_of_result(data.joints, speed),
        friction_leads={}
        if refit.softened is None
        else {
            name: float(lead)
            for name, lead in zip(data.joints, refit.softened.leads, strict=True)
            if lead > LEAST_LEAD
        },
        recordings=recordings,
        transmissions=tuple(measured.result for measured in transmissions),
        twists=tuple(m.series for m in transmissions if m.series is not None),
    )


def _notes(refit: Refit, explanation: Explained, beyond_law: Sequence[str]) -> list[str]:
    """What could not be done, what is missing in the configuration, and why."""
    data, prepared = refit.data, refit.data.prepared
    seconds = sum(recording.duration for recording in prepared.recordings)
    unchecked = why_not_checked(data)
    return [
        explanation.tested.note and f"held-out gaps: {explanation.tested.note}",
        *(floor.note and f"noise floor: {floor.note}" for floor in explanation.floors),
        f"only {seconds:.3g} s were recorded: effects may pass for one another, or for noise; "
        "record a minute or more"
        if seconds < settings.SHORT_RECORDING
        else "",
        *beyond_law,
        *(
            f"{data.joints[joint_finding.joint]} is left out: {joint_finding.sentence}"
            for joint_finding in prepared.joint_findings
            if joint_finding.left_out
        ),
        ARMATURE_MISSING * prepared.armature_missing,
        prepared.why_no_given,
        *data.sources.controller,
        unchecked and f"commands not compared with the control law: {unchecked}",
    ]


def _series(refit: Refit, explanation: Explained) -> tuple[GapSeries, ...]:
    """Measured torque and that of three models for the figures, one series for each joint."""
    data, regression, fit = refit.data, refit.regression, explanation.fit
    residuals, given = nominal_residuals(data, regression), data.prepared.given
    made = []
    for joint, name in enumerate(data.joints):
        torque = regression.joints[joint].torque
        motion = motion_at_rows(data, joint)
        friction = _friction(refit, joint, fit.values)
        for number, effect in enumerate(explanation.effects):
            columns = effect.term.columns
            if effect.term.effect.part == "friction" and joint in columns:
                friction = friction + columns[joint] @ fit.coefficients[explanation.block(number)]
        made.append(
            GapSeries(
                joint=name,
                time=motion.time,
                torque=torque,
                given=None if residuals is None else torque - residuals[joint],
                refit=torque - explanation.fits[0].residuals[joint],
                extended=torque - fit.residuals[joint],
                friction=friction,
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
    kinds = {f"{kind}{joint + 1}" for kind in ("Fv", "Fc", "off")}
    chosen = [place for place, column in enumerate(rows.columns) if names[column] in kinds]
    return np.asarray(rows.matrix[:, chosen] @ values[rows.columns[chosen]])


def _consistent(refit: Refit, explanation: Explained) -> tuple[PhysicalParameters | None, str]:
    """Physical parameters nearest to the extended model, judged on torques without its effects."""
    fit, parameters = explanation.fit, len(explanation.fit.values)
    rows = [
        replace(joint, torque=joint.prediction(fit.values) + residual)
        for joint, residual in zip(refit.regression.joints, fit.residuals, strict=True)
    ]
    sigma = np.array([max(float(np.std(residual)), 1e-300) for residual in fit.residuals])
    covariance = fit.covariance[:parameters, :parameters]
    # Effects of friction share their joint's Fv and Fc: only the sum is friction.
    terms = [effect.term for effect in explanation.effects if effect.term.effect.part == "friction"]
    joints = {joint for term in terms for joint in term.columns}
    shared = [f"{kind}{joint + 1}" for joint in sorted(joints) for kind in ("Fv", "Fc")]
    return consistent_parameters(refit.data.prepared, fit.values, covariance, rows, sigma, shared)
