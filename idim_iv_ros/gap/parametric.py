"""Which given numbers are wrong: the change from the given to the fitted parameters."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from idim_iv_ros.gap.baseline import Baseline
from idim_iv_ros.gap.catalogue import PARAMETRIC
from idim_iv_ros.gap.change_regression import change_regression
from idim_iv_ros.gap.effects.parametric_effect import ParametricEffect
from idim_iv_ros.gap.likelihood import Fit, Regression
from idim_iv_ros.gap.parametric_evidence import ParametricCause, causes_of
from idim_iv_ros.gap.parametric_hypotheses import Hypothesis
from idim_iv_ros.gap.parametric_joints import LEAST_SHARE as JOINT_SHARE
from idim_iv_ros.gap.parametric_selection import smallest_set

FloatArray = NDArray[np.float64]

# Share of the given model's gap that the refit must take; the second where structural effects
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
        RMS of the given model's residual, N m (N); None without a given model.
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
    refit = changes.refit()
    share = changes.share(refit.contributions.sum(axis=1))
    least_share = LEAST_SHARE_BESIDE if regression.added else LEAST_SHARE
    found: list[Hypothesis] = []
    if refit.statistic - refit.rank < least_share * changes.energy or share < least_share:
        reason = f"new parameters take {100.0 * max(share, 0.0):.2g} % of the gap's energy"
    else:
        found = smallest_set(changes, refit, catalogue)
    causes = tuple(
        cause
        for cause in causes_of(data.joints, changes, found, catalogue)
        if cause.share >= LEAST_SHARE_OF_A_CAUSE or cause.share_of_torque >= JOINT_SHARE
    )
    if not causes and not reason:
        reason = "no cause of the catalogue explains the change"
    named = changes.explain([change for cause in causes for change in cause.changes])
    given, after = changes.rms(named.contributions.sum(axis=1))
    _, least = changes.rms(refit.contributions.sum(axis=1))
    return ParametricOutcome(causes, reason, given, after, least, changes.sizes)
