"""From recordings to causes: the whole of `idim-iv diagnose` without its files."""

import os
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np

from idim_iv_ros.compilation import one_thread, return_freed_memory
from idim_iv_ros.configuration import Configuration
from idim_iv_ros.diagnosis import sentences, settings
from idim_iv_ros.diagnosis.against.changes import agreement, numbers_apart, with_effects
from idim_iv_ros.diagnosis.against.contrast import contrasted
from idim_iv_ros.diagnosis.answer.causes import (
    hints_of,
    parametric_causes,
    remaining,
    signal_notes,
    strongest_first,
    structural_causes,
    verdict_of,
)
from idim_iv_ros.diagnosis.answer.explained import (
    Explained,
    explained,
    matters,
    unexplained,
    unexplained_residual,
)
from idim_iv_ros.diagnosis.comparison.candidate import Catalogue
from idim_iv_ros.diagnosis.comparison.ledger import torque_ledger
from idim_iv_ros.diagnosis.comparison.select import select
from idim_iv_ros.diagnosis.controller import check_law, why_not_checked
from idim_iv_ros.diagnosis.identifiability import floor_noise_models, not_shown_by_motion
from idim_iv_ros.diagnosis.refit.baseline import Baseline, nominal_residuals
from idim_iv_ros.diagnosis.refit.refit import Refit, refitted
from idim_iv_ros.diagnosis.result.document import GapResult, GapSeries
from idim_iv_ros.diagnosis.result.recordings import RecordingAgreement
from idim_iv_ros.diagnosis.tracking import simulation_gaps, tracked_stages, tracking_series
from idim_iv_ros.diagnosis.transmission import measured_transmissions, with_transmissions
from idim_iv_ros.diagnosis.where import motion_at_rows, where
from idim_iv_ros.effects.cause import EffectParameter
from idim_iv_ros.effects.registry import STRUCTURAL, name_of
from idim_iv_ros.errors import DataError, UsageError
from idim_iv_ros.files import FilePaths, as_paths
from idim_iv_ros.identification.identify import consistent_parameters, software_versions
from idim_iv_ros.identification.prepare import ARMATURE_MISSING, read_configured
from idim_iv_ros.model import kinematics_digest
from idim_iv_ros.physical import PhysicalParameters
from idim_iv_ros.progress import Progress, Stopwatch
from idim_iv_ros.recording.recording import Recording
from idim_iv_ros.types import FloatArray


def diagnose(
    bags: FilePaths,
    configuration: Configuration,
    *,
    without: Sequence[str] = (),
    against: FilePaths = (),
    progress: Progress | None = None,
) -> GapResult:
    """Say where simulator and robot differ, which effect causes it, and how far the gap shrinks.

    Parameters
    ----------
    bags
        One recording or several of one robot, used together: text or paths.
    configuration
        See `load_configuration`; the URDF, its `<dynamics>` and `simulator` are the nominal model.
    without
        Effects that are left out of the catalogue.
    against
        Recordings of the same robot, or of a simulator of it, that may differ: what changed from
        `bags` to them is `GapResult.contrast`. Everything else is of `bags` alone.
    progress
        Called with a stage in words and the share that is done, 0 to 1.

    Raises
    ------
    UsageError, DataError
        As `identify`.
    """
    excluded = tuple(without)
    given = as_paths(bags)
    second = as_paths(against) if against else ()
    for bag in second:
        if os.path.realpath(bag) in map(os.path.realpath, given):
            raise UsageError(
                f"--against {bag}: it is among the reference recordings, too; "
                "a set cannot differ from itself"
            )
    with one_thread(), Stopwatch(progress) as watch:
        watch.stage("reading", 0.0)
        recordings = read_configured(given, configuration, progress)
        others = read_configured(second, configuration, progress) if second else ()
        return_freed_memory()
        refit, explanation, agreements = of_those_that_agree(
            recordings, configuration, excluded, watch
        )
        return_freed_memory()
        result = concluded(refit, explanation, agreements, configuration, excluded, watch)
        if second:
            watch.stage("contrast", 0.97)
            # Of the configuration with gravity, where it was missing and found.
            prepared = refit.data.prepared
            same = configuration.model_copy(update={"robot": prepared.configuration.robot})
            contrast = contrasted(prepared.session.recordings, others, same, excluded)
            by_itself = f"The reference ({', '.join(result.bags)}) by itself: {result.summary}"
            summary = f"{contrast.sentence} {by_itself}"
            result = replace(result, contrast=contrast, summary=summary)
    result.timing.update(watch.timing)
    return result


def of_those_that_agree(
    recordings: Sequence[Recording],
    configuration: Configuration,
    without: tuple[str, ...],
    watch: Stopwatch,
) -> tuple[Refit, Explained, tuple[RecordingAgreement, ...]]:
    """Search for what explains the gap; where recordings differ, again in the most that agree.

    One payload in one recording of four would make a mean payload with a small interval. All are
    kept where those that agree are fewer than half, or show too little by themselves: what differs
    then is no single thing.
    """
    watch.stage("refit", 0.1)
    refit = refitted(recordings, configuration, without)
    return_freed_memory()
    watch.stage("attribution", 0.2)
    explanation = compared(refit, without)
    catalogue, session = explanation.selection.catalogue, refit.data.prepared.session.recordings
    effects = [effect.term for effect in explanation.effects]
    apart, common = numbers_apart(catalogue, effects), {term.key for term in effects}
    if not apart:
        return refit, explanation, agreement(refit.data, apart)
    watch.stage("recordings that differ", 0.4)
    del explanation, effects  # before others are made
    return_freed_memory()
    agreements = agreement(refit.data, with_effects(catalogue, apart, common))
    groups = [
        [one for one, of in zip(session, agreements, strict=True) if of.differences == alike]
        for alike in sorted((of.differences for of in agreements), key=len)
    ]
    alike = max(groups, key=len)
    watch.stage("recordings that agree", 0.6)
    del catalogue
    return_freed_memory()
    if len(session) / 2 <= len(alike) < len(session):
        with suppress(DataError):  # they show too little by themselves
            refit = refitted(alike, configuration, without)
    return refit, compared(refit, without), agreements


def compared(refit: Refit, without: tuple[str, ...]) -> Explained:
    """Search for what explains the gap, and judge it."""
    catalogue = Catalogue(refit.data, without, refit.hidden)
    return explained(select(catalogue, torque_ledger(refit.data)), refit.on_time)


def concluded(
    refit: Refit,
    explanation: Explained,
    recordings: tuple[RecordingAgreement, ...],
    configuration: Configuration,
    without: tuple[str, ...],
    watch: Stopwatch,
) -> GapResult:
    """Take the steps after the search and build the document.

    `recordings`: all that were given, whether they agree; `configuration`: as it was given.
    """
    data, prepared = refit.data, refit.data.prepared
    watch.stage("simulated motion", 0.85)
    tracked = tracked_stages(explanation)
    stages = tuple(
        replace(stage, tracking_rms=errors.rms, note=errors.note or errors.caveat)
        for stage, errors in zip(explanation.tested.stages, tracked, strict=True)
    )

    numbers, errors = parametric_causes(explanation)
    chain = refit.shift.chain
    differing = {joint: chain.joint_shifts[joint] for joint in chain.differing}
    law = check_law(data, without, shift=refit.shift.common, of_joints=differing)
    law = law.not_shown_by_torque(data, numbers, [effect.term for effect in explanation.effects])
    causes = [
        *structural_causes(explanation, simulation_gaps(explanation, tracked)),
        *numbers,
        *law.causes,
        *(() if refit.gravity is None else (refit.gravity.cause(stages[0]),)),
        *(refit.delays or law.delay),
    ]
    transmissions = measured_transmissions(data)
    causes, shafts, excluded = with_transmissions(data, transmissions, causes, without)
    causes = strongest_first(causes, data)
    hints = hints_of(explanation)

    watch.stage("where", 0.95)
    gaps, findings = where(data, explanation.floors)
    structural = [effect for effect in STRUCTURAL if effect.name not in without]
    noise = floor_noise_models(explanation.fits[0], explanation.floors)
    made = explanation.selection.catalogue.made
    hidden = *not_shown_by_motion(data, structural, noise, made), *refit.not_testable
    named = {(cause.effect, cause.joint) for cause in causes}

    outside = unexplained(explanation)
    residual = unexplained_residual(explanation, stages)
    more_errors = not_named = remaining(errors, settings.LEAST_PARAMETER_ERROR)
    if not causes and not not_named:
        more_errors = remaining(errors, settings.PARAMETRIC_LEAST_TORQUE)
    much_left = bool(residual) or len(data.left_out) == len(data.joints)
    verdict = verdict_of(causes, outside, parameters=bool(not_named), unexplained=much_left)
    left_out = {
        data.joints[finding.joint]: finding.sentence
        for finding in prepared.joint_findings
        if finding.left_out
    }
    bags = tuple(part.bag for part in prepared.session.parts)
    shown, model = gaps.joints, "refit" if prepared.given is None else "nominal model"
    summary = [
        sentences.disagreement(recordings, bags),
        sentences.largest_gap([gap for gap in shown if gap.joint not in left_out], model),
        sentences.nothing_explains(remaining=bool(more_errors)) if verdict == "none" else "",
        causes[0].sentence if causes else "",
        sentences.further_causes(causes[1:]),
        sentences.not_in_catalogue(outside, hints),
        sentences.unexplained_residual(data, residual),
        sentences.remaining_parameter_errors(data, more_errors, hints),
        sentences.next_step(causes, unknown=verdict == "unknown", remaining=bool(more_errors)),
        sentences.left_out(left_out),
        *law.beyond,
        *(cause.sentence for cause in causes[1:] if cause in shafts),
        f"left out of the catalogue on request: {', '.join(without)}" * bool(without),
        ARMATURE_MISSING * prepared.armature_missing,
    ]
    speed, unchecked = None if law.speed is None else law.speed.words, why_not_checked(data)
    seconds = sum(recording.duration for recording in prepared.recordings)
    notes = [
        refit.shift.sentence,
        *signal_notes(data.joints, explanation.selection.terms),
        refit.turning.sentence(data.joints),
        speed and f"the speed in the control law: {speed}",
        *(sentences.transmission(measured.result) for measured in transmissions),
        *excluded,
        explanation.tested.note and f"held-out gaps: {explanation.tested.note}",
        *(floor.note and f"noise floor: {floor.note}" for floor in explanation.floors),
        f"only {seconds:.3g} s were recorded: effects may pass for one another, or for noise; "
        "record a minute or more"
        if seconds < settings.SHORT_RECORDING
        else "",
        *law.beyond,
        sentences.friction_not_given(data, explanation.selection.catalogue.space),
        *(f"{joint} is left out: {why}" for joint, why in left_out.items()),
        ARMATURE_MISSING * prepared.armature_missing,
        prepared.why_no_given,
        *data.sources.controller,
        unchecked and f"commands not compared with the control law: {unchecked}",
        law.too_noisy
        and f"the control law of {', '.join(law.too_noisy)} cannot be told: what differs follows "
        "the noise of the positions",
        *(tracking.note or tracking.caveat for tracking in tracked),
        *prepared.warnings,
        *prepared.advice,
        *prepared.reasons,
        sentences.reversals(configuration, data),
        *(sentences.small_nonparametric(data, t) for t in explanation.outside if not matters(t)),
    ]
    physical, why_not = _consistent(explanation)
    base, values = prepared.model.base, explanation.fit.values.tolist()
    deviations = np.sqrt(np.maximum(np.diag(explanation.fit.covariance), 0.0)).tolist()
    fitted = zip(base.names, values, deviations[: len(values)], base.units, strict=True)
    if refit.gravity is not None:
        with_gravity = replace(stages[0], name=f"+{name_of('gravity')}")
        stages = (refit.gravity.weightless, with_gravity, *stages[1:])
    return GapResult(
        robot=prepared.model.robot.name,
        joints=data.joints,
        joint_types=prepared.model.robot.joint_types,
        bags=bags,
        session=prepared.session.parts,
        software=software_versions(),
        configuration=configuration.model_dump(mode="json", exclude_none=True),
        without=without,
        verdict=verdict,
        summary=sentences.summary(summary),
        left_out=left_out,
        causes=tuple(causes),
        hints=hints,
        unexplained=outside,
        where=gaps,
        findings=findings,
        not_testable=tuple(e for e in hidden if (e.effect, e.joint) not in named),
        stages=stages,
        series=_series(explanation),
        tracking=tracking_series(tracked[0], tracked[-1]),
        notes=tuple(dict.fromkeys(note for note in notes if note)),
        extended_parameters={name: EffectParameter(*number) for name, *number in fitted},
        physical=physical,
        why_no_physical=why_not,
        kinematics=kinematics_digest(prepared.model.robot),
        parameter_errors=errors,
        signal_chain=replace(refit.shift.chain, law_speed=speed),
        friction_leads=refit.turning.soft_leads(data.joints),
        recordings=recordings,
        transmissions=tuple(measured.result for measured in transmissions),
        twists=tuple(m.series for m in transmissions if m.series is not None),
    )


def _series(explanation: Explained) -> tuple[GapSeries, ...]:
    """Measured torque and that of three models for the figures, one series for each joint."""
    data, fit, made = explanation.data, explanation.fit, []
    residuals, given = nominal_residuals(data), data.prepared.given
    for joint, name in enumerate(data.joints):
        torque = data.rows[joint].torque
        friction = _friction(data, joint, fit.values)
        for effect, block in zip(explanation.effects, explanation.regression.blocks, strict=True):
            if effect.term.effect.part == "friction" and joint in effect.term.columns:
                friction = friction + effect.term.columns[joint] @ fit.coefficients[block]
        made.append(
            GapSeries(
                joint=name,
                torque=torque,
                given=None if residuals is None else torque - residuals[joint],
                refit=torque - explanation.fits[0].residuals[joint],
                extended=torque - fit.residuals[joint],
                friction=friction,
                given_friction=None if given is None else _friction(data, joint, given),
                step=1.0 / data.row_rate,
                **motion_at_rows(data, joint),
            )
        )
    return tuple(made)


def _friction(data: Baseline, joint: int, values: FloatArray) -> FloatArray:
    """Friction and offset (r,) of one joint with base parameters (b,), N m (N)."""
    rows, chosen = data.rows[joint], data.columns_of(joint, "Fv", "Fc", "off")
    return np.asarray(rows.matrix[:, chosen] @ values[rows.columns[chosen]])


def _consistent(explanation: Explained) -> tuple[PhysicalParameters | None, str]:
    """Physical parameters nearest to the extended model, judged on torques without its effects."""
    data = explanation.data
    if len(data.left_out) == len(data.joints):
        return None, "every joint is left out"
    fit, b = explanation.fit, len(explanation.fit.values)
    rows = [
        replace(joint, torque=joint.prediction(fit.values) + residual)
        for joint, residual in zip(data.rows, fit.residuals, strict=True)
    ]
    sigma = np.maximum([np.std(residual) for residual in fit.residuals], 1e-300)
    # Effects of friction share their joint's Fv and Fc: only the sum is friction.
    terms = [effect.term for effect in explanation.effects if effect.term.effect.part == "friction"]
    joints = {joint for term in terms for joint in term.columns}
    shared = [f"{kind}{joint + 1}" for joint in sorted(joints) for kind in ("Fv", "Fc")]
    covariance = fit.covariance[:b, :b]
    return consistent_parameters(data.prepared, fit.values, covariance, rows, sigma, shared)
