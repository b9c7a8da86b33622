"""From recordings to causes: the whole of `idim-iv diagnose` without its files."""

from collections.abc import Sequence
from dataclasses import replace
from importlib import metadata
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from idim_iv_ros.configuration import Configuration
from idim_iv_ros.gap.attribution import Attribution, Found, attribute
from idim_iv_ros.gap.baseline import Baseline, baseline
from idim_iv_ros.gap.catalogue import STRUCTURAL
from idim_iv_ros.gap.controller_check import controller_mismatch, why_not_checked
from idim_iv_ros.gap.effects.controller_mismatch import ControllerMismatch
from idim_iv_ros.gap.effects.effect import Place
from idim_iv_ros.gap.effects.encoder_eccentricity import EncoderEccentricity
from idim_iv_ros.gap.effects.gravity_direction import GravityDirection
from idim_iv_ros.gap.generic import GENERIC
from idim_iv_ros.gap.held_out import HeldOut, held_out
from idim_iv_ros.gap.left_over import left_over
from idim_iv_ros.gap.likelihood import Regression
from idim_iv_ros.gap.missing_gravity import missing_gravity
from idim_iv_ros.gap.noise_floor import NoiseFloor, Repeat, noise_floors, repeats_of
from idim_iv_ros.gap.other_causes import controller_results, parametric_results
from idim_iv_ros.gap.parametric import PARAMETRIC, parametric_causes
from idim_iv_ros.gap.regression_rows import smooth_regression
from idim_iv_ros.gap.result import Cause, EffectParameter, GapResult, GapSeries, NotTestable
from idim_iv_ros.gap.structural_causes import (
    NamedModel,
    built_model,
    effect_parameters,
    label,
    named_model,
    simulated_effects,
    structural_causes,
)
from idim_iv_ros.gap.testability import dry_friction, floor_colours, shown_by_motion
from idim_iv_ros.gap.tracking import (
    Tracking,
    simulated_tracking,
    simulation_gap,
    tracking_series,
    with_tracking,
)
from idim_iv_ros.gap.unexplained import unexplained
from idim_iv_ros.gap.verdict import summary_of, verdict_of
from idim_iv_ros.gap.where import given_residuals, given_values, picked, reversal_distances, where
from idim_iv_ros.gap.wrong_numbers import WRONG_NUMBERS
from idim_iv_ros.preparation import read_configured
from idim_iv_ros.recording import Recording
from idim_iv_ros.stopwatch import Progress, Stopwatch

FloatArray = NDArray[np.float64]

# Of the held-out torque gap, what is left at most where an effect does no harm. Effects of high
# frequency shrink the whitened residual much and the gap itself little.
_NO_WORSE = 1.01
_SHORT = 10.0  # s
_REPORTED = ("idim-iv-ros", "numpy", "scipy", "pin", "numba", "rosbags")


def diagnose(
    bags: Sequence[Path],
    configuration: Configuration,
    *,
    without: Sequence[str] = (),
    progress: Progress | None = None,
) -> GapResult:
    """Say where simulator and robot differ, which effect causes it, and how far the gap shrinks.

    Parameters
    ----------
    bags
        Recordings of one robot, used together.
    configuration
        See `load_configuration`; the URDF, its `<dynamics>` and `simulator` are the given model.
    without
        Effects that are left out of the catalogue.
    progress
        Called with a stage in words and the share that is done, 0 to 1.

    Raises
    ------
    UsageError, DataError
        As `identify`.
    """
    with threadpool_limits(limits=1, user_api="blas"), Stopwatch(progress) as watch:
        watch.stage("reading", 0.0)
        recordings = read_configured(bags, configuration, progress)
        result = _diagnosed(recordings, configuration, tuple(without), watch)
    result.timing.update(watch.timing)
    return result


def diagnose_recordings(
    recordings: Sequence[Recording],
    configuration: Configuration,
    *,
    without: Sequence[str] = (),
    progress: Progress | None = None,
) -> GapResult:
    """Diagnose recordings that were read before; otherwise as `diagnose`."""
    with threadpool_limits(limits=1, user_api="blas"), Stopwatch(progress) as watch:
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
    watch.stage("attribution", 0.2)
    catalogue = [effect for effect in STRUCTURAL if effect.name not in without]
    wrong = [effect for effect in WRONG_NUMBERS if effect.name not in without]
    attribution = attribute(data, regression, [*catalogue, *wrong, *GENERIC], watch.progress)
    model = named_model(attribution)
    watch.stage("held-out gaps", 0.8)
    repeats = repeats_of(data)
    floors = noise_floors(data, attribution.extended, attribution.fit, repeats)
    given = given_values(data)
    model, tested = _confirmed(data, attribution, model, floors, repeats, given)
    watch.stage("simulated motion", 0.85)
    tracked = _tracked(data, model, given)
    simulations = [
        simulation_gap(
            tracked[tested.refit + number],
            tracked[tested.refit + number + 1],
            found.candidate.place.joint,
        )
        for number, found in enumerate(model.found)
    ]
    causes = structural_causes(data, model, tested, simulations, attribution.tried)
    parametric = [effect for effect in PARAMETRIC if effect.name not in without]
    # With what has no name, too: it would else pass for wrong numbers.
    outcome = parametric_causes(data, model.whole, model.whole.fit(model.fit.colours), parametric)
    causes += parametric_results(data, outcome, floors)
    if gravity is not None and weightless is not None:
        causes.append(gravity.cause(weightless, tested))
    if ControllerMismatch.name not in without:
        turned = {c.joint for c in causes if c.effect == EncoderEccentricity.name}
        findings = [each for each in controller_mismatch(data) if each.joint not in turned]
        causes += controller_results(data, findings)
    colours = floor_colours(attribution.refit, [floor.sigma for floor in floors])
    confusability, not_testable = shown_by_motion(
        data, regression, catalogue, colours, dry_friction(data)
    )
    watch.stage("where", 0.95)
    place = where(data, regression, attribution.refit, floors)
    rest = unexplained(data, model, floors)
    causes = _strongest_first(causes, data)
    verdict = verdict_of(causes, rest)
    stages = with_tracking(tested.stages(), tracked)
    left = left_over(data, stages[-1], floors)
    if weightless is not None:
        stages = (weightless.stage(0), replace(stages[0], name="+gravity_direction"), *stages[1:])
    first, last = (tracked[0], tracked[-1]) if tracked else (None, None)
    return GapResult(
        robot=data.prepared.model.robot.name,
        joints=data.joints,
        joint_types=data.prepared.model.robot.joint_types,
        bags=tuple(recording.path.name for recording in recordings),
        software={name: metadata.version(name) for name in _REPORTED},
        configuration=configuration.model_dump(mode="json", exclude_none=True),
        without=without,
        verdict=verdict,
        summary=summary_of(verdict, causes, rest, place.joint_gaps, without, left),
        causes=tuple(causes),
        unexplained=rest,
        joint_gaps=place.joint_gaps,
        regimes=place.regimes,
        findings=place.findings,
        not_testable=tuple(each for each in not_testable if not _accepted(each, causes)),
        stages=stages,
        confusability=confusability,
        series=_series(data, regression, model),
        tracking=tracking_series(data, first, last),
        notes=_notes(data, tested.note, [floor.note for floor in floors], tracked),
        extended_parameters=_extended(data, model),
        recorded=sum(recording.duration for recording in recordings),
    )


def _confirmed(
    data: Baseline,
    attribution: Attribution,
    model: NamedModel,
    floors: Sequence[NoiseFloor],
    repeats: Sequence[Repeat],
    given: FloatArray | None,
) -> tuple[NamedModel, HeldOut]:
    """Drop effects that do not help on data not used to fit, and test again without them."""

    def tested(model: NamedModel) -> HeldOut:
        labels = [label(data, found) for found in model.found]
        return held_out(data, model.regression, model.fit, labels, floors, repeats, given)

    first = tested(model)
    helpful: list[Found] = []
    doubtful: set[int] = set()  # joints where what came later may patch what did not hold
    for number, each in enumerate(model.found):
        joint = each.candidate.place.joint
        if joint not in doubtful and _helps(first, number, each):
            helpful.append(each)
        else:
            doubtful.add(joint)
    if len(helpful) == len(model.found):
        return model, first
    model = built_model(attribution, helpful, model.nameless)
    return model, tested(model)


def _helps(tested: HeldOut, number: int, found: Found) -> bool:
    """Whether the whitened residual shrinks on held-out data, and the gap does not grow."""
    stage = tested.refit + number
    gap = tested.gap(stage, stage + 1, found.candidate.place.joint)
    return tested.gain(number)[0] > 0.0 and gap.after < _NO_WORSE * gap.before


def _accepted(refused: NotTestable, causes: Sequence[Cause]) -> bool:
    return any((cause.effect, cause.joint) == (refused.effect, refused.joint) for cause in causes)


def _strongest_first(causes: Sequence[Cause], data: Baseline) -> list[Cause]:
    """Structural causes by their evidence, parametric ones by the gap that they close.

    The kind that holds the cause that closes most of the gap comes first.
    """
    structural = [cause for cause in causes if cause.kind == "structural"]
    parametric = [cause for cause in causes if cause.kind == "parametric"]
    structural.sort(key=lambda cause: -cause.evidence.statistic)
    parametric.sort(key=lambda cause: -_closed(cause, data))
    groups = sorted(
        [structural, parametric],
        key=lambda group: -max((_closed(cause, data) for cause in group), default=0.0),
    )
    return [*groups[0], *groups[1]]


def _closed(cause: Cause, data: Baseline) -> float:
    """Energy of the torque gap that a cause closes, as a share of the torque's."""
    closed = cause.torque_gap.before**2 - cause.torque_gap.after**2
    joints = range(len(data.joints)) if cause.joint is None else [data.joints.index(cause.joint)]
    whole = sum(float(np.mean(data.rows[joint].torque ** 2)) for joint in joints)
    return closed / max(whole, 1e-300)


def _given_alone(data: Baseline, regression: Regression) -> HeldOut:
    """Stages of the given model and its refit."""
    fit, repeats = regression.fit(), repeats_of(data)
    floors = noise_floors(data, regression, fit, repeats)
    return held_out(data, regression, fit, [], floors, repeats, given_values(data))


def _tracked(data: Baseline, model: NamedModel, given: FloatArray | None) -> list[Tracking]:
    """Tracking of every stage, in their order."""
    tracked = [] if given is None else [simulated_tracking(data, given)]
    effects: list[tuple[str, Place, dict[str, EffectParameter]]] = []
    for number, fit in enumerate(model.fits):
        if number > 0:
            candidate = model.found[number - 1].candidate
            parameters = effect_parameters(model, number - 1)
            effects.append((candidate.effect.name, candidate.place, parameters))
        simulated = simulated_effects(data, effects)
        tracked.append(simulated_tracking(data, fit.values, simulated))
        if number > 0 and tracked[-1].note and not tracked[-2].note:
            # The stages that follow do without it, rather than without any simulation.
            dropped = effects.pop()[0]
            kept = simulated_tracking(data, fit.values, simulated_effects(data, effects))
            if not kept.note:
                note = f"simulated without {dropped}: {tracked[-1].note}"
                tracked[-1] = replace(kept, caveat=note)
    return tracked


def _series(data: Baseline, regression: Regression, model: NamedModel) -> tuple[GapSeries, ...]:
    residuals = given_residuals(data, regression)
    made = []
    for joint, name in enumerate(data.joints):
        torque = regression.joints[joint].torque
        time = picked(data, joint, [motion.time for motion in data.motions])
        made.append(
            GapSeries(
                joint=name,
                time=time,
                torque=torque,
                given=None if residuals is None else torque - residuals[joint],
                refit=torque - model.fits[0].residuals[joint],
                extended=torque - model.fit.residuals[joint],
                position=picked(data, joint, [m.position[:, joint] for m in data.motions]),
                speed=picked(data, joint, [m.velocity[:, joint] for m in data.motions]),
                load=picked(data, joint, [m.load[:, joint] for m in data.motions]),
                since_reversal=reversal_distances(data, joint),
                step=1.0 / data.row_rate,
            )
        )
    return tuple(made)


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
    notes += [*data.sources.controller]
    unchecked = why_not_checked(data)
    if unchecked:
        notes.append(f"commands not compared with the control law: {unchecked}")
    notes += [each.note or each.caveat for each in tracked]
    notes += list(data.prepared.reasons)
    return tuple(dict.fromkeys(note for note in notes if note))


def _extended(data: Baseline, model: NamedModel) -> dict[str, EffectParameter]:
    base = data.prepared.model.base
    deviations = np.sqrt(np.maximum(np.diag(model.fit.covariance), 0.0))
    return {
        name: EffectParameter(float(model.fit.values[k]), float(deviations[k]), base.units[k])
        for k, name in enumerate(base.names)
    }
