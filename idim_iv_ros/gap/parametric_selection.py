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
    known: Sequence[Hypothesis] = (),
) -> list[Hypothesis]:
    """Add the best cause until they are enough, and drop those that are not needed.

    Parameters
    ----------
    refit
        All that new base parameters explain.
    known
        Causes that are in the model in any case; the others are found beside them, in what they
        leave. They are not among those returned.
    """
    kept: list[Hypothesis] = list(known)
    start = before = changes.explain(changes_of(known))
    while len(kept) < MOST_CAUSES + len(known):
        tried = trials(changes, kept, catalogue)
        if not tried or tried[0].support < LEAST_SUPPORT:
            break
        best = tried[0]
        if best.explained.statistic - before.statistic < LEAST_PART * (
            refit.statistic - start.statistic
        ):
            break
        kept.append(best.hypothesis)
        before = best.explained
        if explains_enough(before, refit, start):
            break
    for each in kept[len(known) :]:
        rest = [other for other in kept if other is not each]
        explained = changes.explain(changes_of(rest))
        if rest[len(known) :] and explains_enough(explained, refit, start):
            kept = rest
    return kept[len(known) :]


def explains_enough(explained: Explained, refit: Explained, start: Explained) -> bool:
    """Whether what is missing to `ENOUGH` of the refit may be noise, both beyond the start."""
    free = max(refit.rank - explained.rank, 0)
    missing = refit.statistic - explained.statistic - free
    explainable = (refit.statistic - start.statistic) - (refit.rank - start.rank)
    return bool(missing <= (1.0 - ENOUGH) * explainable + 2.0 * np.sqrt(2.0 * free))
