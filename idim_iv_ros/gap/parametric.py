"""Which given numbers are wrong: the change from the given to the fitted parameters."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from idim_iv_ros.gap.baseline import Baseline
from idim_iv_ros.gap.catalogue import PARAMETRIC
from idim_iv_ros.gap.change_regression import change_regression
from idim_iv_ros.gap.effects.parametric_effect import ParametricEffect
from idim_iv_ros.gap.likelihood import Fit, Regression
from idim_iv_ros.gap.parametric_evidence import ParametricCause, causes_of
from idim_iv_ros.gap.parametric_hypotheses import Hypothesis, changes_of
from idim_iv_ros.gap.parametric_selection import explains_enough, smallest_set

FloatArray = NDArray[np.float64]

# Share of the given model's gap that the refit must take; the second where structural effects
# were accepted, for what is left of them biases the refit.
LEAST_SHARE, LEAST_SHARE_BESIDE = 0.01, 0.05
# Share of the gap's energy that each cause must take, beside those before it.
LEAST_SHARE_OF_A_CAUSE = 0.02


@dataclass(frozen=True)
class ParametricOutcome:
    """What is wrong with the given numbers.

    Attributes
    ----------
    causes : tuple of ParametricCause
        Strongest first; empty where nothing is wrong.
    statistic : float
        Wald statistic of the change of all base parameters; 0 without a given model.
    degrees : int
        Of freedom.
    p_value : float
    share : float
        Of the energy of the given model's gap that new base parameters take away.
    explained : float
        Of that change, by the causes together, less what noise would: about 0 to 1.
    complete : bool
        Whether the causes are enough: they explain `ENOUGH`, beyond noise.
    before, after : (n_joints,)
        RMS of the given model's residual, and with all causes, N m (N).
    reason : str
        Why there are no causes; empty otherwise.
    """

    causes: tuple[ParametricCause, ...]
    statistic: float
    degrees: int
    p_value: float
    share: float
    explained: float
    complete: bool
    before: FloatArray
    after: FloatArray
    reason: str


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
        return ParametricOutcome((), 0.0, 0, 1.0, 0.0, 0.0, False, nothing, nothing, reason)
    changes = change_regression(data, regression, fit)
    refit = changes.refit()
    whole = refit.contributions.sum(axis=1)
    share = changes.share(whole)
    p_value = float(stats.chi2.sf(refit.statistic, refit.rank))
    least = LEAST_SHARE_BESIDE if regression.added else LEAST_SHARE
    excess = refit.statistic - refit.rank
    before, _ = changes.rms(whole)
    if excess < least * changes.energy or share < least:
        found: list[Hypothesis] = []
        reason = f"new parameters take {100.0 * max(share, 0.0):.2g} % of the gap's energy"
    else:
        found = smallest_set(changes, refit, catalogue)
        reason = "" if found else "no cause of the catalogue explains the change"
    explained = changes.explain(changes_of(found))
    part = (explained.statistic - explained.rank) / max(excess, 1.0)
    causes = tuple(
        cause
        for cause in causes_of(data.joints, changes, found, catalogue, excess)
        if cause.share >= LEAST_SHARE_OF_A_CAUSE
    )
    _, after = changes.rms(explained.contributions.sum(axis=1))
    return ParametricOutcome(
        causes=causes,
        statistic=refit.statistic,
        degrees=refit.rank,
        p_value=p_value,
        share=share,
        explained=part,
        complete=bool(found) and explains_enough(explained, refit),
        before=before,
        after=after,
        reason=reason,
    )
