"""Whether one set of parameters holds for all recordings, and which recording differs in what.

A payload mounted for some recordings and not for others makes one mean payload with a small
interval: a wrong number that looks sure. So each recording is held against the others, beside the
structural effects that were accepted, before parameters are pooled in any answer.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.parametric.contrast import Contrast, OneSetTest, contrast
from idim_iv_ros.diagnosis.parametric.evidence import ParametricCause, causes_of
from idim_iv_ros.diagnosis.parametric.selection import smallest_set
from idim_iv_ros.diagnosis.refit.baseline import Baseline
from idim_iv_ros.diagnosis.structural.likelihood import Fit, Regression
from idim_iv_ros.effects.parametric_effect import ParametricEffect


@dataclass(frozen=True)
class RecordingDifference:
    """One recording that the parameters of the others do not fit.

    Attributes
    ----------
    recording : int
        From 0, in the order of the session.
    test : OneSetTest
    p_value : float
        Of the test, times the number of recordings it was chosen from (Bonferroni).
    causes : tuple of ParametricCause
        What differs from the other recordings, strongest first; empty where nothing of the
        catalogue explains it.
    """

    recording: int
    test: OneSetTest
    p_value: float
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
    data: Baseline, regression: Regression, fit: Fit, catalogue: Sequence[ParametricEffect]
) -> Agreement:
    """Hold each recording against the others, and set apart those that differ, one by one.

    Of two recordings that differ the second is named: nothing says which of them is right.

    Parameters
    ----------
    regression
        With the accepted structural effects as added columns.
    fit
        Of that regression.
    catalogue
        Parametric effects by which recordings may differ.
    """
    count = len(data.motions)
    if count < 2:
        return Agreement((), ())
    apart: list[int] = []
    found: list[RecordingDifference] = []
    first: tuple[OneSetTest, ...] = ()
    while len(apart) < count - 1:
        others = [number for number in range(count) if number not in apart]
        tried = {
            number: contrast(data, regression, fit, {number}, apart=[{each} for each in apart])
            for number in others
        }
        tests = {number: each.test() for number, each in tried.items()}
        first = first or tuple(tests[number] for number in range(count))
        differing = [number for number in others if _differs(tests[number], len(others))]
        if not differing:
            break
        most = max(differing, key=lambda number: (_excess(tests[number]), number))
        p_value = min(1.0, len(others) * tests[most].p_value)
        causes = _causes(data, tried[most], catalogue)
        found.append(RecordingDifference(most, tests[most], p_value, causes))
        apart.append(most)
    return Agreement(first, tuple(found))


def _differs(test: OneSetTest, count: int) -> bool:
    return (
        count * test.p_value < settings.AGREEMENT_LEVEL
        and test.folds_positive >= settings.AGREEMENT_LEAST_FOLDS
        and float(test.shares.max()) >= settings.AGREEMENT_LEAST_SHARE
    )


def _excess(test: OneSetTest) -> float:
    """Energy beyond what one set leaves by chance; rounded, since two of two are the same test."""
    return round((test.statistic - 1.0) * test.df, 3)


def _causes(
    data: Baseline, apart: Contrast, catalogue: Sequence[ParametricEffect]
) -> tuple[ParametricCause, ...]:
    refit = apart.changes.refit()
    kept = smallest_set(apart.changes, refit, catalogue)
    causes = causes_of(data.joints, apart.changes, kept, catalogue)
    return tuple(each for each in causes if np.isfinite(each.statistic))
