"""The smallest set of hypotheses that explains a change of the given numbers."""

from collections.abc import Sequence

import numpy as np

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.parametric.change_regression import ChangeRegression, Explained
from idim_iv_ros.diagnosis.parametric.hypotheses import (
    Hypothesis,
    changes_of,
    of_base_parameters,
    trials,
)
from idim_iv_ros.diagnosis.parametric.joints import missing, with_every_joint
from idim_iv_ros.effects.parametric_effect import ParametricEffect


def smallest_set(
    changes: ChangeRegression,
    refit: Explained,
    catalogue: Sequence[ParametricEffect],
    known: Sequence[Hypothesis] = (),
) -> list[Hypothesis]:
    """Add the best cause until they are enough, and drop those that are not needed.

    They are enough where they explain most of the change. If a few more account for what matters
    at every joint, these are added. Where neither a few explain most of the torque, most numbers
    are wrong: each joint's friction, offset and drive, and each link, are causes then.

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
    while len(kept) < settings.MOST_PARAMETRIC_CAUSES + len(known):
        tried = trials(changes, kept, catalogue)
        if not tried or tried[0].support < settings.LEAST_SUPPORT:
            break
        best = tried[0]
        if best.explained.statistic - before.statistic < settings.LEAST_PART_OF_CHANGE * (
            refit.statistic - start.statistic
        ):
            break
        kept.append(best.hypothesis)
        before = best.explained
        if explains_enough(before, refit, start):
            break
    kept = _needed(changes, refit, kept, known)
    if not missing(changes, changes.explain(changes_of(kept)), refit).any():
        return kept[len(known) :]
    more = with_every_joint(changes, refit, kept, catalogue)
    more = _needed(changes, refit, more, known)
    if len(more) <= settings.MOST_PARAMETRIC_CAUSES + len(known):
        return more[len(known) :]
    explained = changes.explain(changes_of(kept))
    if _share(changes, explained) >= settings.ENOUGH_OF_CHANGE * _share(changes, refit):
        return kept[len(known) :]
    return of_base_parameters(changes, catalogue, known)


def _share(changes: ChangeRegression, explained: Explained) -> float:
    return changes.share(explained.contributions.sum(axis=1))


def _needed(
    changes: ChangeRegression,
    refit: Explained,
    found: Sequence[Hypothesis],
    known: Sequence[Hypothesis],
) -> list[Hypothesis]:
    """Drop what the others make up for, one after the other, always what costs least.

    The known causes come first and stay.
    """
    kept = list(found)
    start = changes.explain(changes_of(known))
    lacking = np.count_nonzero(missing(changes, changes.explain(changes_of(kept)), refit))
    while len(kept) > len(known) + 1:
        droppable = kept[len(known) :]
        without = [[other for other in kept if other is not each] for each in droppable]
        explained = [changes.explain(changes_of(rest)) for rest in without]
        able = [
            number
            for number, each in enumerate(explained)
            if explains_enough(each, refit, start)
            and np.count_nonzero(missing(changes, each, refit)) <= lacking
        ]
        if not able:
            break
        kept = without[max(able, key=lambda number: explained[number].statistic)]
    return kept


def explains_enough(explained: Explained, refit: Explained, start: Explained) -> bool:
    """Whether what is missing to enough of the refit may be noise, both beyond the start."""
    free = max(refit.rank - explained.rank, 0)
    missing = refit.statistic - explained.statistic - free
    explainable = (refit.statistic - start.statistic) - (refit.rank - start.rank)
    return bool(
        missing <= (1.0 - settings.ENOUGH_OF_CHANGE) * explainable + 2.0 * np.sqrt(2.0 * free)
    )
