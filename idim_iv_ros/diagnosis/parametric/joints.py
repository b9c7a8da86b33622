"""Joints whose torque new numbers explain and the causes found do not: each is to be accounted for.

The likelihood looks at all joints together, each by its noise: a gap of 2 N m at a joint whose
motor is loud counts less than one of 0.5 N m at a quiet one. What the simulator's user sees is the
share of a joint's torque.
"""

from collections.abc import Sequence

import numpy as np

from idim_iv_ros.diagnosis.parametric.change_regression import ChangeRegression, Explained
from idim_iv_ros.diagnosis.parametric.hypotheses import Hypothesis, Trial, changes_of, trials
from idim_iv_ros.effects.parametric_effect import ParametricEffect
from idim_iv_ros.types import FloatArray

# Share of a joint's torque (rms) from which on a parameter error matters, and times the gap of the
# refit that is left beside it.
LEAST_SHARE, TIMES_REFIT = 0.02, 1.5
# Of the energy that is missing at a joint, what one more cause must take.
_LEAST_PART = 0.25
# Of what the best one takes there, what a cause must take to be chosen for its likelihood.
_NEARLY = 0.67


def missing(changes: ChangeRegression, explained: Explained, refit: Explained) -> FloatArray:
    """Energy at each joint that the refit takes beyond what is explained, (n_joints,), N²m² (N²).

    Zero where it is small: `LEAST_SHARE`.
    """
    after = _after(changes, explained)
    least = _after(changes, refit)
    energy = after**2 - least**2
    matters = (energy > (LEAST_SHARE * changes.sizes) ** 2) & (after > TIMES_REFIT * least)
    return np.where(matters, energy, 0.0)


def with_every_joint(
    changes: ChangeRegression,
    refit: Explained,
    kept: Sequence[Hypothesis],
    catalogue: Sequence[ParametricEffect],
    least_support: float,
) -> list[Hypothesis]:
    """Add causes until each joint is accounted for, or no cause explains what is missing there.

    Parameters
    ----------
    refit
        All that new base parameters explain.
    kept
        Causes found so far.
    least_support
        Logarithm of the likelihood that a cause must bring beyond its penalty.
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
            trial for trial in trials(changes, found, catalogue) if trial.support >= least_support
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
    if most < _LEAST_PART * lacking:
        return None
    near = [trial for trial, energy in zip(able, taken, strict=True) if energy >= _NEARLY * most]
    return max(near, key=lambda trial: trial.support)


def _after(changes: ChangeRegression, explained: Explained) -> FloatArray:
    """RMS of each joint's residual with what is explained, N m (N)."""
    return changes.rms(explained.contributions.sum(axis=1))[1]
