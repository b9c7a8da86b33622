"""Whether one set of parameters holds for all recordings, and which recording differs in what.

A payload mounted for some recordings and not for others makes one mean payload with a small
interval: a wrong number that looks sure. So each recording is held against the others, beside the
structural effects that were accepted, before parameters are pooled in any answer.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.parametric.contrast import (
    Contrast,
    OneSetTest,
    PooledRows,
    with_own_parameters,
)
from idim_iv_ros.diagnosis.parametric.evidence import ParametricCause, causes_of
from idim_iv_ros.diagnosis.parametric.selection import smallest_set
from idim_iv_ros.diagnosis.refit.baseline import Baseline
from idim_iv_ros.diagnosis.structural.attribution import Attribution
from idim_iv_ros.diagnosis.structural.likelihood import Fit, Regression
from idim_iv_ros.diagnosis.structural.nonparametric import Nonparametric
from idim_iv_ros.effects.parametric_effect import ParametricEffect
from idim_iv_ros.signals import AutoregressiveModel
from idim_iv_ros.types import FloatArray


@dataclass(frozen=True)
class RecordingDifference:
    """One recording that the parameters of the others do not fit.

    Attributes
    ----------
    recording : int
        From 0, in the order of the session.
    test : OneSetTest
    causes : tuple of ParametricCause
        What differs from the other recordings, strongest first; empty where nothing of the
        catalogue explains it, or where no parameters make the model right.
    """

    recording: int
    test: OneSetTest
    causes: tuple[ParametricCause, ...]


@dataclass(frozen=True)
class Agreement:
    """Outcome for all recordings.

    Attributes
    ----------
    tests : tuple of OneSetTest
        Of each recording against all the others.
    differences : tuple of RecordingDifference
        Empty where one set of parameters holds.
    """

    tests: tuple[OneSetTest, ...]
    differences: tuple[RecordingDifference, ...]


def agreement(
    data: Baseline, attribution: Attribution, catalogue: Sequence[ParametricEffect]
) -> Agreement:
    """Hold each recording against the others, beside the effects that were accepted.

    Functions of time that are no effect of the catalogue are left out: they take up any difference
    between recordings, and say less of it.

    Parameters
    ----------
    attribution
        What was accepted.
    catalogue
        Parametric effects by which recordings may differ.
    """
    if len(data.motions) < 2:
        return Agreement((), ())
    regression = attribution.regression
    for each in (found.candidate for found in attribution.found):
        if not (isinstance(each.effect, Nonparametric) and each.effect.family == "time"):
            regression = regression.with_columns(each.columns)
    return agreement_beside(
        data, regression, regression.fit(attribution.fit.noise_models), catalogue
    )


def agreement_beside(
    data: Baseline, regression: Regression, fit: Fit, catalogue: Sequence[ParametricEffect]
) -> Agreement:
    """Set apart the recordings that differ, one by one.

    Of two recordings that differ the second is named: nothing says which of them is right.

    Parameters
    ----------
    regression
        With structural effects as added columns.
    fit
        Of that regression.
    catalogue
        Parametric effects by which recordings may differ.
    """
    count = len(data.motions)
    found: list[RecordingDifference] = []
    first: tuple[OneSetTest, ...] = ()
    others = list(range(count))
    while len(others) > 1:
        pooled = PooledRows(data, regression, fit)
        alpha = settings.AGREEMENT_LEVEL / len(others)  # of all of them together (Bonferroni)
        tests = {number: pooled.contrast({number}).test(alpha) for number in others}
        first = first or tuple(tests[number] for number in range(count))
        differing = [number for number in others if _differs(tests[number])]
        if not differing:
            break
        most = max(differing, key=lambda number: (_excess(tests[number]), number))
        own = with_own_parameters(data, regression, {most})
        better = own.fit(fit.noise_models)
        causes: tuple[ParametricCause, ...] = ()
        if _fits(tests[most], np.array([noise.sigma for noise in better.noise_models])):
            slow = tuple(slow_noise(each) for each in better.noise_models)
            rows = PooledRows(data, regression, replace(fit, noise_models=slow))
            causes = _causes(data, rows.contrast({most}), catalogue)
        found.append(RecordingDifference(most, tests[most], causes))
        others.remove(most)
        regression, fit = own, better
    # Where one differs in nothing that can be named the model misses something, which another
    # recording's parameters imitate.
    sure = all(each.causes for each in found)
    return Agreement(first, tuple(each if sure else replace(each, causes=()) for each in found))


def slow_noise(noise: AutoregressiveModel) -> AutoregressiveModel:
    """White noise that tells as little of what is slow as an autocorrelated one does.

    What differs is estimated with it. Filters that whiten give weight to what is fast: to
    reversals, at which the simulated motion of the one parameter set is wrong by the difference
    itself, and the parameters then come out too small. Its variance is that of the noise, times
    how much larger that is than the variance of the innovations.
    """
    return AutoregressiveModel(np.zeros(0), noise.variance**2 / noise.innovation_variance)


def _differs(test: OneSetTest) -> bool:
    return (
        test.hypothesis.accepted is False
        and test.folds_positive >= settings.AGREEMENT_LEAST_FOLDS
        and float(test.shares.max()) >= settings.AGREEMENT_LEAST_SHARE
    )


def _fits(test: OneSetTest, sigma: FloatArray) -> bool:
    """Whether parameters of its own make the model right where the recording differs most.

    They take half of the residual there, or leave little but noise (n_joints,). Else the model
    misses something, and parameters that imitate it differ from motion to motion.
    """
    joint = int(np.argmax(test.shares))
    before, after = test.before[joint], test.after[joint]
    return bool(
        after <= settings.AGREEMENT_LEAST_TAKEN * before
        or after <= settings.AGREEMENT_OVER_NOISE * sigma[joint]
    )


def _excess(test: OneSetTest) -> float:
    """Energy beyond what one set leaves by chance; rounded, since two of two are the same test."""
    hypothesis = test.hypothesis
    return round(((hypothesis.statistic or 0.0) - 1.0) * (hypothesis.df or 0), 3)


def _causes(
    data: Baseline, apart: Contrast, catalogue: Sequence[ParametricEffect]
) -> tuple[ParametricCause, ...]:
    refit = apart.changes.refit()
    kept = smallest_set(apart.changes, refit, catalogue)
    return causes_of(data.joints, apart.changes, kept, catalogue)
