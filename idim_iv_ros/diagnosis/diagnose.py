"""From recordings to causes: the whole of `idim-iv diagnose` without its files."""

from collections.abc import Sequence
from dataclasses import replace
from importlib import metadata

import numpy as np

from idim_iv_ros.configuration import Configuration
from idim_iv_ros.diagnosis.cause_order import leading, strongest_first
from idim_iv_ros.diagnosis.controller.check import LawCheck, check_law, why_not_checked
from idim_iv_ros.diagnosis.gap_series import gap_series
from idim_iv_ros.diagnosis.held_out.held_out import HeldOut, held_out
from idim_iv_ros.diagnosis.identifiability.testability import floor_noise_models, shown_by_motion
from idim_iv_ros.diagnosis.localisation.unexplained import small_remainders, unexplained
from idim_iv_ros.diagnosis.localisation.unexplained_joints import unexplained_joints
from idim_iv_ros.diagnosis.localisation.where import where
from idim_iv_ros.diagnosis.other_causes import controller_results, parametric_results
from idim_iv_ros.diagnosis.parametric.causes import ParametricOutcome, parametric_causes
from idim_iv_ros.diagnosis.parametric.confounders import confounders
from idim_iv_ros.diagnosis.parametric.errors_beyond_base import ERRORS_BEYOND_BASE
from idim_iv_ros.diagnosis.parametric.parameter_errors import parameter_errors, remaining_words
from idim_iv_ros.diagnosis.refit.baseline import Baseline, baseline
from idim_iv_ros.diagnosis.refit.dry_friction import dry_friction
from idim_iv_ros.diagnosis.refit.missing_gravity import missing_gravity
from idim_iv_ros.diagnosis.refit.noise_floor import NoiseFloor, noise_floors, repeats_of
from idim_iv_ros.diagnosis.refit.regression_rows import smooth_regression
from idim_iv_ros.diagnosis.refit.signal_chain import aligned
from idim_iv_ros.diagnosis.result import Cause, EffectParameter, GapResult, NotTestable
from idim_iv_ros.diagnosis.structural.attribution import attribute
from idim_iv_ros.diagnosis.structural.causes import NamedModel, named_model, structural_causes
from idim_iv_ros.diagnosis.structural.confirmation import confirmed
from idim_iv_ros.diagnosis.structural.likelihood import Regression
from idim_iv_ros.diagnosis.structural.nonparametric import NONPARAMETRIC
from idim_iv_ros.diagnosis.tracked_stages import simulation_gaps, tracked_stages
from idim_iv_ros.diagnosis.tracking import Tracking, tracking_series, with_tracking
from idim_iv_ros.diagnosis.verdict import summary_of, verdict_of
from idim_iv_ros.effects.controller_mismatch import ControllerMismatch
from idim_iv_ros.effects.encoder_eccentricity import EncoderEccentricity
from idim_iv_ros.effects.gravity_direction import GravityDirection
from idim_iv_ros.effects.registry import PARAMETRIC, STRUCTURAL
from idim_iv_ros.file_paths import FilePaths
from idim_iv_ros.identification.prepare import ARMATURE_MISSING, read_configured
from idim_iv_ros.one_thread import one_thread
from idim_iv_ros.progress import Progress, Stopwatch
from idim_iv_ros.recording import Recording

_SHORT = 10.0  # s
_REPORTED = ("idim-iv-ros", "numpy", "scipy", "pin", "numba", "rosbags")


def diagnose(
    bags: FilePaths,
    configuration: Configuration,
    *,
    without: Sequence[str] = (),
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
    progress
        Called with a stage in words and the share that is done, 0 to 1.

    Raises
    ------
    UsageError, DataError
        As `identify`.
    """
    with one_thread(), Stopwatch(progress) as watch:
        watch.stage("reading", 0.0)
        recordings = read_configured(bags, configuration, progress)
        result = _diagnosed(recordings, configuration, tuple(without), watch)
    result.timing.update(watch.timing)
    return result


def _diagnosed(
    recordings: Sequence[Recording],
    configuration: Configuration,
    without: tuple[str, ...],
    watch: Stopwatch,
) -> GapResult:
    watch.stage("refit", 0.1)
    data = baseline(recordings, configuration)
    regression = smooth_regression(data)
    weightless = None
    gravity = missing_gravity(data, regression) if GravityDirection.name not in without else None
    if gravity is not None:
        weightless = _given_alone(data, regression)
        data = baseline(recordings, gravity.corrected(configuration))
        regression = smooth_regression(data)
    data, regression, shift = aligned(data, regression)
    watch.stage("attribution", 0.2)
    catalogue = [effect for effect in STRUCTURAL if effect.name not in without]
    wrong = [effect for effect in ERRORS_BEYOND_BASE if effect.name not in without]
    attribution = attribute(data, regression, [*catalogue, *wrong, *NONPARAMETRIC], watch.progress)
    model = named_model(attribution)
    watch.stage("held-out gaps", 0.8)
    repeats = repeats_of(data)
    floors = noise_floors(data, attribution.extended, attribution.fit, repeats)
    given = data.prepared.given
    model, tested = confirmed(data, attribution, model, floors, repeats, given)
    watch.stage("simulated motion", 0.85)
    tracked = tracked_stages(data, model, given)
    simulations = simulation_gaps(model, tracked, tested.refit)
    causes = structural_causes(data, model, tested, simulations, attribution.tried)
    parametric = [effect for effect in PARAMETRIC if effect.name not in without]
    # With what has no name, too, where it matters: it would else pass for parameter errors.
    whole = model.with_nonparametric(data.torque_sizes)
    outcome = parametric_causes(data, whole, whole.fit(model.fit.noise_models), parametric)
    law = check_law(data) if ControllerMismatch.name not in without else LawCheck()
    causes += _other_causes(data, model, outcome, floors, law, without)
    if gravity is not None and weightless is not None:
        causes.append(gravity.cause(weightless, tested))
    noise_models = floor_noise_models(attribution.refit, [floor.sigma for floor in floors])
    confusability, not_testable = shown_by_motion(
        data, regression, catalogue, noise_models, dry_friction(data)
    )
    watch.stage("where", 0.95)
    place = where(data, regression, attribution.refit, floors)
    rest = unexplained(data, model)
    causes = strongest_first(causes, data)
    told = leading(causes, data)
    errors = parameter_errors(data, outcome)
    numbers = remaining_words(data, errors)
    stages = with_tracking(tested.stages(), tracked)
    left = unexplained_joints(data, stages, floors)
    verdict = verdict_of(causes, rest, parameters=bool(numbers), unexplained=bool(left))
    if weightless is not None:
        stages = (weightless.stage(0), replace(stages[0], name="+gravity_direction"), *stages[1:])
    first, last = (tracked[0], tracked[-1]) if tracked else (None, None)
    return GapResult(
        robot=data.prepared.model.robot.name,
        joints=data.joints,
        joint_types=data.prepared.model.robot.joint_types,
        bags=tuple(part.bag for part in data.prepared.session.parts),
        session=data.prepared.session.parts,
        software={name: metadata.version(name) for name in _REPORTED},
        configuration=configuration.model_dump(mode="json", exclude_none=True),
        without=without,
        verdict=verdict,
        summary=_nominal_words(data)
        + summary_of(
            verdict,
            told,
            rest,
            place.joint_gaps,
            without,
            left,
            numbers=numbers,
            more=len(causes) - len(told),
            model="refit" if given is None else "nominal model",
        )
        + "".join(f" {sentence[0].upper()}{sentence[1:]}." for sentence in law.beyond),
        causes=tuple(causes),
        unexplained=rest,
        joint_gaps=place.joint_gaps,
        regimes=place.regimes,
        findings=place.findings,
        not_testable=tuple(each for each in not_testable if not _accepted(each, causes)),
        stages=stages,
        confusability=confusability,
        series=gap_series(data, regression, model),
        tracking=tracking_series(data, first, last),
        notes=(
            shift.sentence(data.joints),
            *([] if law.speed is None else [f"the speed in the control law: {law.speed.words}"]),
            *_notes(data, tested.note, [floor.note for floor in floors], tracked),
            *small_remainders(data, model),
        ),
        extended_parameters=_extended(data, model),
        recorded=sum(part.duration for part in data.prepared.session.parts),
        parameter_errors=errors,
        signal_chain=shift.part_of_result(
            data.joints, None if law.speed is None else law.speed.words
        ),
    )


def _other_causes(
    data: Baseline,
    model: NamedModel,
    outcome: ParametricOutcome,
    floors: Sequence[NoiseFloor],
    law: LawCheck,
    without: Sequence[str],
) -> list[Cause]:
    """Wrong numbers, and another control law."""
    structural = [effect for effect in STRUCTURAL if effect.name not in without]
    found = [
        replace(
            each,
            indistinguishable_from=(
                *each.indistinguishable_from,
                *confounders(data, each, structural),
            ),
        )
        for each in outcome.causes
    ]
    causes = parametric_results(data, found, floors)
    turned = {
        data.joints[found.candidate.place.joint]
        for found in model.found
        if found.candidate.effect.name == EncoderEccentricity.name
    }
    findings = [each for each in law.findings if each.joint not in turned]
    return causes + controller_results(data, findings)


def _nominal_words(data: Baseline) -> str:
    """What the configuration leaves out of the nominal model, before anything is told of it."""
    return f"{ARMATURE_MISSING.capitalize()}. " if data.prepared.armature_missing else ""


def _accepted(refused: NotTestable, causes: Sequence[Cause]) -> bool:
    return any((cause.effect, cause.joint) == (refused.effect, refused.joint) for cause in causes)


def _given_alone(data: Baseline, regression: Regression) -> HeldOut:
    """Stages of the nominal model and its refit."""
    fit, repeats = regression.fit(), repeats_of(data)
    floors = noise_floors(data, regression, fit, repeats)
    return held_out(data, regression, fit, [], floors, repeats, data.prepared.given)


def _notes(
    data: Baseline, folds: str, floors: Sequence[str], tracked: Sequence[Tracking]
) -> tuple[str, ...]:
    notes = [f"held-out gaps: {folds}"] if folds else []
    notes += [f"noise floor: {note}" for note in dict.fromkeys(floors) if note]
    seconds = sum(recording.duration for recording in data.prepared.recordings)
    if seconds < _SHORT:
        notes.append(
            f"only {seconds:.3g} s were recorded: effects may pass for one another, or for noise; "
            "record a minute or more"
        )
    notes += [data.prepared.why_no_given, *data.sources.controller]
    unchecked = why_not_checked(data)
    if unchecked:
        notes.append(f"commands not compared with the control law: {unchecked}")
    notes += [each.note or each.caveat for each in tracked]
    notes += [*data.prepared.doubts, *data.prepared.advice, *data.prepared.reasons]
    return tuple(dict.fromkeys(note for note in notes if note))


def _extended(data: Baseline, model: NamedModel) -> dict[str, EffectParameter]:
    base = data.prepared.model.base
    deviations = np.sqrt(np.maximum(np.diag(model.fit.covariance), 0.0))
    return {
        name: EffectParameter(float(model.fit.values[k]), float(deviations[k]), base.units[k])
        for k, name in enumerate(base.names)
    }
