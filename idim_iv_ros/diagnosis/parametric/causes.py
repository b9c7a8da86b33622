"""Which given numbers are wrong: the change from the given to the fitted parameters."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from idim_iv_ros.diagnosis.parametric.change_regression import ChangeRegression, change_regression
from idim_iv_ros.diagnosis.parametric.evidence import ParametricCause, causes_of
from idim_iv_ros.diagnosis.parametric.hypotheses import Hypothesis, changes_of
from idim_iv_ros.diagnosis.parametric.joints import LEAST_SHARE as JOINT_SHARE
from idim_iv_ros.diagnosis.parametric.selection import smallest_set
from idim_iv_ros.diagnosis.refit.baseline import Baseline
from idim_iv_ros.diagnosis.refit.missing_armature import left_out_numbers, without_negative_drives
from idim_iv_ros.diagnosis.structural.likelihood import Fit, Regression
from idim_iv_ros.effects.parametric_effect import ParametricEffect
from idim_iv_ros.effects.registry import PARAMETRIC
from idim_iv_ros.types import FloatArray

# Share of the nominal model's gap that the refit must take; the second where structural effects
# were accepted, for what is left of them biases the refit.
LEAST_SHARE, LEAST_SHARE_BESIDE = 0.01, 0.05
# Share of the gap's energy that each cause must take, beside those before it, unless it takes that
# of one joint: `parametric_joints.LEAST_SHARE` of its torque.
LEAST_SHARE_OF_A_CAUSE = 0.02


@dataclass(frozen=True)
class ParametricOutcome:
    """What is wrong with the given numbers.

    Attributes
    ----------
    causes : tuple of ParametricCause
        Strongest first; empty where nothing is wrong.
    reason : str
        Why there are no causes; empty otherwise.
    given : (n_joints,) or None
        RMS of the nominal model's residual, N m (N); None without a nominal model.
    after, refit : (n_joints,)
        The same with the causes, and with new base parameters.
    sizes : (n_joints,)
        RMS of the recorded torque, N m (N).
    """

    causes: tuple[ParametricCause, ...]
    reason: str
    given: FloatArray | None
    after: FloatArray
    refit: FloatArray
    sizes: FloatArray


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
    reason = data.prepared.why_no_given
    if reason:
        nothing = np.full(len(data.joints), np.nan)
        return ParametricOutcome((), reason, None, nothing, nothing, nothing)
    changes = change_regression(data, regression, fit)
    least_share = LEAST_SHARE_BESIDE if regression.added else LEAST_SHARE
    while True:
        known = left_out_numbers(changes, catalogue)
        found, reason = _other_numbers(changes, known, least_share, catalogue)
        physical = without_negative_drives(changes, known, found)
        if physical.space.bare_drives == changes.space.bare_drives:
            break
        changes = physical
    causes = _large_enough(causes_of(data.joints, changes, [*known, *found], catalogue), changes)
    if not causes and not reason:
        reason = "no cause of the catalogue explains the change"
    named = changes.explain([change for cause in causes for change in cause.changes])
    given, after = changes.rms(named.contributions.sum(axis=1))
    _, least = changes.rms(changes.refit().contributions.sum(axis=1))
    return ParametricOutcome(causes, "" if causes else reason, given, after, least, changes.sizes)


def _other_numbers(
    changes: ChangeRegression,
    known: Sequence[Hypothesis],
    least: float,
    catalogue: Sequence[ParametricEffect],
) -> tuple[list[Hypothesis], str]:
    """Causes beside the known ones, as if the nominal model had these; or why there are none."""
    refit, start = changes.refit(), changes.explain(changes_of(known))
    share, taken = (changes.share(each.contributions.sum(axis=1)) for each in (refit, start))
    beyond = (refit.statistic - start.statistic) - (refit.rank - start.rank)
    too_little = beyond < least * (changes.energy - start.statistic)
    if too_little or share - taken < least * (1.0 - taken):
        return [], f"new parameters take {100.0 * max(share, 0.0):.2g} % of the gap's energy"
    return smallest_set(changes, refit, catalogue, known), ""


def _large_enough(
    causes: Sequence[ParametricCause], changes: ChangeRegression
) -> tuple[ParametricCause, ...]:
    """Causes that take enough of the gap beside what was left out, or of a joint's torque."""
    kept, gap = [], 1.0
    for cause in causes:
        enough = cause.share >= LEAST_SHARE_OF_A_CAUSE * gap
        if enough or cause.share_of_torque >= JOINT_SHARE:
            kept.append(cause)
        if cause.effect.known_to_be_left_out(changes.space):
            gap -= cause.share
    return tuple(kept)
