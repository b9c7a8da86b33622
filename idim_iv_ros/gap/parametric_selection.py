"""The smallest set of hypotheses that explains a change of the given numbers."""

from collections.abc import Sequence

import numpy as np

from idim_iv_ros.gap.change_regression import ChangeRegression, Explained
from idim_iv_ros.gap.effects.parametric_effect import ParametricEffect
from idim_iv_ros.gap.parametric_hypotheses import Hypothesis, changes_of, trials

# Share of the explainable change that the causes must explain together.
ENOUGH = 0.9
# Logarithm of the likelihood that a cause must bring beyond its penalty.
LEAST_SUPPORT = 8.0
# Share of the explainable change that each cause must bring.
LEAST_PART = 0.02
MOST_CAUSES = 6


def smallest_set(
    changes: ChangeRegression,
    refit: Explained,
    catalogue: Sequence[ParametricEffect],
) -> list[Hypothesis]:
    """Add the best cause until they are enough, and drop those that are not needed.

    Parameters
    ----------
    refit
        All that new base parameters explain.
    """
    kept: list[Hypothesis] = []
    before = changes.explain([])
    while len(kept) < MOST_CAUSES:
        tried = trials(changes, kept, catalogue)
        if not tried or tried[0].support < LEAST_SUPPORT:
            break
        best = tried[0]
        if best.explained.statistic - before.statistic < LEAST_PART * refit.statistic:
            break
        kept.append(best.hypothesis)
        before = best.explained
        if explains_enough(before, refit):
            break
    for each in list(kept):
        rest = [other for other in kept if other is not each]
        explained = changes.explain(changes_of(rest))
        if rest and explains_enough(explained, refit):
            kept = rest
    return kept


def explains_enough(explained: Explained, refit: Explained) -> bool:
    """Whether what is missing to `ENOUGH` of the refit may be noise."""
    free = max(refit.rank - explained.rank, 0)
    missing = refit.statistic - explained.statistic - free
    return bool(
        missing <= (1.0 - ENOUGH) * (refit.statistic - refit.rank) + 2.0 * np.sqrt(2.0 * free)
    )
