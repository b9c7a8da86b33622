"""Which parameters of the nominal model are in error: the change from these to the fitted ones."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from idim_iv_ros.diagnosis import sentences, settings
from idim_iv_ros.diagnosis.parametric.change_regression import ChangeRegression, change_regression
from idim_iv_ros.diagnosis.parametric.doubts import ParametricDoubt, doubts_of
from idim_iv_ros.diagnosis.parametric.evidence import ParametricCause, judged
from idim_iv_ros.diagnosis.parametric.hypotheses import Hypothesis, changes_of
from idim_iv_ros.diagnosis.parametric.missing import missing_parameters, without_negative_drives
from idim_iv_ros.diagnosis.parametric.selection import smallest_set
from idim_iv_ros.diagnosis.refit.baseline import Baseline
from idim_iv_ros.diagnosis.refit.noise_floor import NoiseFloor, common_floor
from idim_iv_ros.diagnosis.result import (
    NOT_CALIBRATED,
    Cause,
    Evidence,
    Gap,
    Indistinguishable,
    JointChange,
    ParameterError,
)
from idim_iv_ros.diagnosis.structural.candidate import operating_range, rows_of, spread_shapes
from idim_iv_ros.diagnosis.structural.likelihood import Fit, Regression
from idim_iv_ros.effects.effect import Effect, OperatingRange
from idim_iv_ros.effects.parametric_effect import ParametricEffect
from idim_iv_ros.effects.registry import PARAMETRIC
from idim_iv_ros.types import FloatArray


def confounders(
    data: Baseline, cause: ParametricCause, catalogue: Sequence[Effect]
) -> tuple[Indistinguishable, ...]:
    """Structural effects whose torque is that of a parameter error on this recording.

    Those that no recording separates from it always count.

    `Indistinguishable.correlation` is the multiple correlation of the cause's torque with the
    effect's columns, in the best of a few shapes.
    """
    if cause.joint is None or cause.torque is None:
        return ()
    joint = data.joints.index(cause.joint)
    covered = operating_range(data)
    others = []
    for effect in catalogue:
        if effect.name in cause.effect.same_as:
            others.append(Indistinguishable(effect.name, cause.joint, 1.0))
        if effect.name not in cause.effect.confounders:
            continue
        correlation = _correlation(data, effect, joint, cause.torque, covered)
        if correlation >= settings.CONFOUNDER_CORRELATION:
            others.append(Indistinguishable(effect.name, cause.joint, correlation))
    return tuple(others)


def _correlation(
    data: Baseline, effect: Effect, joint: int, torque: FloatArray, covered: OperatingRange
) -> float:
    """Largest over the shapes, 0 to 1."""
    energy = float(torque @ torque)
    places = [place for place in effect.places(len(data.joints)) if place.joint == joint]
    if not places or energy <= 0.0:
        return 0.0
    shapes = spread_shapes(effect, places[0], covered)
    if not shapes:
        return 0.0
    largest = 0.0
    for shape, columns in zip(shapes, rows_of(data, effect, places[0], shapes), strict=True):
        coefficients = np.asarray(np.linalg.lstsq(columns[joint], torque, rcond=None)[0])
        if effect.admissible(shape, coefficients):
            rest = torque - columns[joint] @ coefficients
            largest = max(largest, 1.0 - float(rest @ rest) / energy)
    return float(np.sqrt(max(largest, 0.0)))


@dataclass(frozen=True)
class ParametricOutcome:
    """What is wrong with the given numbers.

    Attributes
    ----------
    causes : tuple of ParametricCause
        Strongest first; empty where nothing is wrong.
    given : (n_joints,) or None
        RMS of the nominal model's residual, N m (N); None without a nominal model.
    after, refit : (n_joints,)
        The same with the causes, and with new base parameters.
    sizes : (n_joints,)
        RMS of the recorded torque, N m (N).
    doubts : tuple of ParametricDoubt
        Parameter errors that may be there: hints.
    """

    causes: tuple[ParametricCause, ...]
    given: FloatArray | None
    after: FloatArray
    refit: FloatArray
    sizes: FloatArray
    doubts: tuple[ParametricDoubt, ...] = ()


def parametric_causes(
    data: Baseline,
    regression: Regression,
    fit: Fit,
    catalogue: Sequence[ParametricEffect] = PARAMETRIC,
) -> ParametricOutcome:
    """Find the smallest set of causes that explains the change of the given parameters.

    Parameters
    ----------
    data
    regression
        The extended one: accepted structural effects are its added columns
        (`Attribution.extended`, or `smooth_regression` where there are none).
    fit
        Of that regression.
    catalogue
    """
    if data.prepared.why_no_given:
        nothing = np.full(len(data.joints), np.nan)
        return ParametricOutcome((), None, nothing, nothing, nothing)
    changes = change_regression(data, regression, fit)
    least_share = (
        settings.REFIT_LEAST_SHARE_BESIDE if regression.added else settings.REFIT_LEAST_SHARE
    )
    while True:
        known = missing_parameters(changes, catalogue)
        found = _other_causes(changes, known, least_share, catalogue)
        physical = without_negative_drives(changes, known, found)
        if physical.space.bare_drives == changes.space.bare_drives:
            break
        changes = physical
    all_causes, doubtful = judged(data.joints, changes, [*known, *found], catalogue)
    causes = _large_enough(all_causes, changes)
    named = changes.explain([change for cause in causes for change in cause.changes])
    given, after = changes.rms(named.contributions.sum(axis=1))
    _, least = changes.rms(changes.refit().contributions.sum(axis=1))
    return ParametricOutcome(
        causes,
        given,
        after,
        least,
        changes.sizes,
        doubts_of(data.joints, changes, doubtful, causes),
    )


def _other_causes(
    changes: ChangeRegression,
    known: Sequence[Hypothesis],
    least: float,
    catalogue: Sequence[ParametricEffect],
) -> list[Hypothesis]:
    """Causes beside the known ones, as if the nominal model had these.

    None where new parameters take too little of the gap.
    """
    refit, start = changes.refit(), changes.explain(changes_of(known))
    share, taken = (changes.share(each.contributions.sum(axis=1)) for each in (refit, start))
    beyond = (refit.statistic - start.statistic) - (refit.rank - start.rank)
    too_little = beyond < least * (changes.energy - start.statistic)
    if too_little or share - taken < least * (1.0 - taken):
        return []
    return smallest_set(changes, refit, catalogue, known)


def _large_enough(
    causes: Sequence[ParametricCause], changes: ChangeRegression
) -> tuple[ParametricCause, ...]:
    """Causes that take enough of the gap beside what was left out, or of a joint's torque.

    Of a gap that hardly matters at any joint even all of it is not enough.
    """
    kept, gap = [], 1.0
    for cause in causes:
        enough = (
            cause.share >= settings.PARAMETRIC_LEAST_SHARE * gap
            and cause.share_of_torque >= settings.PARAMETRIC_LEAST_TORQUE
        )
        if enough or cause.share_of_torque >= settings.LEAST_PARAMETER_ERROR:
            kept.append(cause)
        if cause.effect.known_to_be_left_out(changes.space):
            gap -= cause.share
    return tuple(kept)


def parameter_errors(data: Baseline, outcome: ParametricOutcome) -> tuple[ParameterError, ...]:
    """Gap of the nominal model at each joint, with the causes and with all parameters refitted."""
    if outcome.given is None:
        return ()
    errors = []
    for joint, name in enumerate(data.joints):
        if joint in data.left_out:
            continue
        named, refit = float(outcome.after[joint]), float(outcome.refit[joint])
        remaining = float(np.sqrt(max(named**2 - refit**2, 0.0)))
        errors.append(
            ParameterError(
                joint=name,
                given=float(outcome.given[joint]),
                named=named,
                refit=refit,
                remaining=remaining,
                share_of_torque=remaining / float(outcome.sizes[joint]),
            )
        )
    return tuple(errors)


def remaining(errors: Sequence[ParameterError], least: float | None = None) -> list[ParameterError]:
    """Joints at which a parameter error remains that no cause names, the largest share first.

    Parameters
    ----------
    errors
    least
        Share of a joint's torque that counts; None: `LEAST_PARAMETER_ERROR`.
    """
    least = float(settings.LEAST_PARAMETER_ERROR) if least is None else least
    return sorted(
        (
            each
            for each in errors
            if each.share_of_torque > least
            and each.named > settings.PARAMETER_ERROR_OVER_REFIT * each.refit
        ),
        key=lambda each: -each.share_of_torque,
    )


def parametric_results(
    data: Baseline,
    found: Sequence[ParametricCause],
    floors: Sequence[NoiseFloor],
    structural: Sequence[Effect],
) -> list[Cause]:
    """Return causes as they are reported.

    Parameters
    ----------
    structural
        Effects of the catalogue, which may be indistinguishable from parameter errors.
    """
    results = []
    for each in found:
        others = (*each.indistinguishable_from, *confounders(data, each, structural))
        cause = replace(each, indistinguishable_from=others)
        changed = _joint_changes(data, cause)
        results.append(
            Cause(
                effect=cause.effect.name,
                kind="parametric",
                joint=cause.joint,
                other_joint=None,
                parameters=cause.parameters,
                evidence=Evidence(cause.statistic, None, None, "", p_value_from=NOT_CALIBRATED),
                indistinguishable_from=others,
                torque_gap=_gap(data, cause, floors),
                simulation_gap=None,
                sentence=sentences.parametric_cause(data, cause, changed),
                joint_gaps=changed,
            )
        )
    return results


def _joint_changes(data: Baseline, cause: ParametricCause) -> tuple[JointChange, ...]:
    """Joints whose gap the cause changes, its own first and then the largest share first."""
    changed = [
        data.joint_change(joint, before, after)
        for joint, (before, after) in enumerate(zip(cause.before, cause.after, strict=True))
    ]
    kept = [
        each
        for each in changed
        if each.joint == cause.joint or abs(each.share_of_torque) >= settings.LEAST_PARAMETER_ERROR
    ]
    return tuple(sorted(kept, key=lambda each: (each.joint != cause.joint, -each.share_of_torque)))


def _gap(data: Baseline, cause: ParametricCause, floors: Sequence[NoiseFloor]) -> Gap:
    own = None if cause.joint is None else data.joints.index(cause.joint)
    which = list(range(len(data.joints))) if own is None else [own]
    before = float(np.sqrt(np.sum(cause.before[which] ** 2)))
    after = float(np.sqrt(np.sum(cause.after[which] ** 2)))
    floor = common_floor([floors[joint] for joint in which])
    room = before - (floor or 0.0)
    shrinkage = (before - after) / room if room > settings.LEAST_ROOM * before else None
    return Gap(before, after, floor, shrinkage, None)
