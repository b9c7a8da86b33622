"""Joints whose torque new numbers explain and the causes found do not: each is to be accounted for.

The likelihood looks at all joints together, each by its noise: a gap of 2 N m at a joint whose
motor is loud counts less than one of 0.5 N m at a quiet one. What the simulator's user sees is the
share of a joint's torque.
"""

from collections.abc import Sequence

import numpy as np

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.parametric.change_regression import ChangeRegression, Explained
from idim_iv_ros.diagnosis.parametric.hypotheses import Hypothesis, Trial, changes_of, trials
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
