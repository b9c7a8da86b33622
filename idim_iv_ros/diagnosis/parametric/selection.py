"""The smallest set of hypotheses that explains a change of the parameters, at every joint.

The likelihood looks at all joints together, each by its noise: a gap of 2 N m at a joint whose
motor is loud counts less than one of 0.5 N m at a quiet one. What the simulator's user sees is the
share of a joint's torque: each joint whose torque new parameters explain is to be accounted for.
"""

from collections.abc import Sequence

import numpy as np

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.parametric.change_regression import ChangeRegression, Explained
from idim_iv_ros.diagnosis.parametric.hypotheses import (
    Hypothesis,
    Trial,
    changes_of,
    of_base_parameters,
    trials,
)
from idim_iv_ros.effects.parametric_effect import ParametricEffect
from idim_iv_ros.types import FloatArray


def missing(changes: ChangeRegression, explained: Explained, refit: Explained) -> FloatArray:
    """Energy at each joint that the refit takes beyond what is explained, (n_joints,), N²m² (N²).

    Zero where it is small: `settings.LEAST_PARAMETER_ERROR`.
    """
    after = _after(changes, explained)
    least = _after(changes, refit)
    energy = after**2 - least**2
    matters = (energy > (settings.LEAST_PARAMETER_ERROR * changes.sizes) ** 2) & (
        after > settings.PARAMETER_ERROR_OVER_REFIT * least
    )
    return np.where(matters, energy, 0.0)


def with_every_joint(
    changes: ChangeRegression,
    refit: Explained,
    kept: Sequence[Hypothesis],
    catalogue: Sequence[ParametricEffect],
) -> list[Hypothesis]:
    """Add causes until each joint is accounted for, or no cause explains what is missing there.

    Parameters
    ----------
    refit
        All that new base parameters explain.
    kept
        Causes found so far.
    """
    found = list(kept)
    explained = changes.explain(changes_of(found))
    given_up: set[int] = set()
    while True:
        lacking = missing(changes, explained, refit)
        shares = [
            0.0 if joint in given_up else energy / changes.sizes[joint] ** 2
            for joint, energy in enumerate(lacking)
        ]
        worst = int(np.argmax(shares))
        if shares[worst] <= 0.0:
            return found
        able = [
            trial
            for trial in trials(changes, found, catalogue)
            if trial.support >= settings.LEAST_SUPPORT
        ]
        best = _best_at(changes, able, worst, explained, lacking[worst])
        if best is None:
            given_up.add(worst)
            continue
        found.append(best.hypothesis)
        explained = best.explained


def _best_at(
    changes: ChangeRegression,
    able: Sequence[Trial],
    joint: int,
    explained: Explained,
    lacking: float,
) -> Trial | None:
    """Of the trials that take most of what a joint lacks the one that is supported best."""
    before = _after(changes, explained)[joint] ** 2
    taken = [before - _after(changes, trial.explained)[joint] ** 2 for trial in able]
    most = max(taken, default=0.0)
    if most < settings.LEAST_PART_OF_JOINT * lacking:
        return None
    near = [
        trial
        for trial, energy in zip(able, taken, strict=True)
        if energy >= settings.NEARLY_ALL_OF_JOINT * most
    ]
    return max(near, key=lambda trial: trial.support)


def _after(changes: ChangeRegression, explained: Explained) -> FloatArray:
    """RMS of each joint's residual with what is explained, N m (N)."""
    return changes.rms(explained.contributions.sum(axis=1))[1]


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
        missing
        <= (1.0 - settings.ENOUGH_OF_CHANGE) * explainable
        + settings.CHANGE_DEVIATIONS * np.sqrt(2.0 * free)
    )
