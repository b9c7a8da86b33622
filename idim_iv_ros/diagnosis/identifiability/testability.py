"""Which effects a recording can show, from its motion alone: before torque is looked at."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.identifiability.detectability import (
    Absorption,
    Detectability,
    ShapedEffect,
    detectability,
)
from idim_iv_ros.diagnosis.refit.baseline import Baseline
from idim_iv_ros.diagnosis.result import Confusability, NotTestable
from idim_iv_ros.diagnosis.structural.candidate import operating_range, rows_of, spread_shapes
from idim_iv_ros.diagnosis.structural.likelihood import Fit, Regression
from idim_iv_ros.effects.effect import Effect, JointScale, OperatingRange, Place
from idim_iv_ros.signals import AutoregressiveModel

_LARGEST_TORQUE = 1e6  # N m, from which on a shape's transmission has run away
_ASSUMED_DRY_FRICTION = 0.05  # largest torques of a joint that shows none: sizes are judged by it
_TORQUE = "an effort that is the torque of this joint, in enough rows"


def cannot_show(effect: Effect, joint: int, covered: OperatingRange) -> str:
    """Why an effect cannot be seen at a joint whatever its size; empty where it may be.

    Each effect adds what it needs itself.
    """
    if joint in covered.left_out:
        return "its torque is left out: the summary says why"
    lever = float(covered.lever[joint])
    span, length = covered.span(joint), covered.length(joint)
    fastest = float(covered.fastest[joint])
    if (
        span <= settings.LEAST_RANGE * lever
        or fastest <= settings.LEAST_SPEED_RANGE * covered.slowest[joint]
    ):
        return f"the joint hardly moves ({span:.2g} {length})"
    if fastest < settings.LEAST_FASTEST * lever:
        return (
            f"the joint moves at most {fastest:.2g} {length}/s: it sticks so often that its dry "
            "friction hides everything else"
        )
    return effect.cannot_show(joint, covered)


def too_little(joint: int, covered: OperatingRange) -> bool:
    """Whether a joint moves so little that not even its parameters can be determined.

    Slow motion over a wide range shows weights and friction well; small motion that sticks shows
    nothing, and no more does a torque that is left out.
    """
    if joint in covered.left_out:
        return True
    lever = float(covered.lever[joint])
    span = covered.span(joint)
    fastest = float(covered.fastest[joint])
    if span <= settings.LEAST_RANGE * lever:
        return True
    return fastest < settings.LEAST_FASTEST * lever and span < settings.SMALL_RANGE * lever


def shown_by_motion(
    data: Baseline,
    regression: Regression,
    catalogue: Sequence[Effect],
    noise_models: Sequence[AutoregressiveModel],
) -> tuple[tuple[Confusability, ...], tuple[NotTestable, ...]]:
    """Say what the motion can show and what it cannot.

    Parameters
    ----------
    regression
        Of the refit; only its regressor is used, not its torque.
    noise_models
        Noise of each joint, known beforehand or bounded from below (`floor_noise_models`).
    """
    covered = operating_range(data)
    absorption = Absorption(regression, noise_models)
    rows = [len(joint.torque) for joint in regression.joints]
    friction = _dry_friction(data, covered)
    tables, refused = [], []
    for joint, name in enumerate(data.joints):
        candidates: list[ShapedEffect] = []
        for effect in catalogue:
            for place in _places(effect, joint, len(data.joints)):
                reason = cannot_show(effect, joint, covered)
                made = None if reason else _shaped(data, effect, place, covered)
                if made is None:
                    reason = reason or "no shape of it is possible on this motion"
                    reason = data.unit_at(joint, reason)
                    needed = _TORQUE if joint in covered.left_out else effect.excitation
                    refused.append(NotTestable(effect.name, name, reason, needed))
                else:
                    candidates.append(made)
        if not candidates:
            continue
        scale = JointScale(covered, joint, friction[joint])
        measured, correlation = detectability(absorption, candidates, rows[joint], scale)
        for candidate, measure in zip(candidates, measured, strict=True):
            refusal = _refusal(candidate, measure, name)
            if refusal is not None:
                refused.append(
                    replace(
                        refusal,
                        reason=data.unit_at(joint, refusal.reason),
                        smallest=data.unit_at(joint, refusal.smallest),
                    )
                )
        tables.append(
            Confusability(
                joint=name,
                effects=tuple(candidate.effect.name for candidate in candidates),
                correlation=correlation,
                absorbed=np.array([measure.absorbed for measure in measured]),
                smallest=tuple(data.unit_at(joint, each.smallest) for each in measured),
            )
        )
    return tuple(tables), tuple(refused)


def floor_noise_models(fit: Fit, sigmas: Sequence[float | None]) -> tuple[AutoregressiveModel, ...]:
    """Noise models of a fit with the standard deviations of the noise floor where it is smaller."""
    return tuple(
        noise
        if sigma is None or sigma >= noise.sigma
        else replace(noise, innovation_variance=sigma**2)
        for noise, sigma in zip(fit.noise_models, sigmas, strict=True)
    )


def _places(effect: Effect, joint: int, joints: int) -> list[Place]:
    """Places at a joint; of pairs the one with the next joint."""
    places = [place for place in effect.places(joints) if place.joint == joint]
    return places[:1]


def _shaped(
    data: Baseline, effect: Effect, place: Place, covered: OperatingRange
) -> ShapedEffect | None:
    shapes = spread_shapes(effect, place, covered)
    if not shapes:
        return None
    usable = [
        (shape, columns)
        for shape, columns in zip(shapes, rows_of(data, effect, place, shapes), strict=True)
        if all(np.max(np.abs(rows), initial=0.0) < _LARGEST_TORQUE for rows in columns.values())
    ]
    if not usable:
        return None
    return ShapedEffect(effect, place, [s for s, _ in usable], [c for _, c in usable])


def _refusal(candidate: ShapedEffect, measure: Detectability, joint: str) -> NotTestable | None:
    effect = candidate.effect
    if measure.least_absorbed > settings.ABSORBED:
        share = 100.0 * measure.least_absorbed
        reason = f"the model's own parameters absorb {share:.1f} % of it on this motion"
        return NotTestable(effect.name, joint, reason, effect.excitation)
    if not measure.smallest:
        reason = "its torque stays within the noise at every size that was tried"
        return NotTestable(effect.name, joint, reason, effect.excitation)
    if not measure.plausible:
        reason = f"only sizes from {measure.smallest} would be seen, and smaller ones are common"
        return NotTestable(effect.name, joint, reason, effect.excitation, measure.smallest)
    return None


def _dry_friction(data: Baseline, covered: OperatingRange) -> list[float]:
    """Dry friction of each joint, N m (N): of the refit, or a share of the peak if it has none."""
    levels = data.prepared.model.dynamic_parameters(data.estimate.linear.values).coulomb
    return [
        float(level)
        if level > settings.LEAST_DRY_FRICTION * peak
        else _ASSUMED_DRY_FRICTION * float(peak)
        for level, peak in zip(levels, covered.torque, strict=True)
    ]
