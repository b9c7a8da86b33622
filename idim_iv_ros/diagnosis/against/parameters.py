"""Parametric causes for what differs between the sets: errors of the nominal model cancel."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.against.blocks import block_errors, clearly_better
from idim_iv_ros.diagnosis.against.sets import TwoSets
from idim_iv_ros.diagnosis.against.structural import StructuralOutcome
from idim_iv_ros.diagnosis.parametric.agreement import agreement_beside, slow_noise
from idim_iv_ros.diagnosis.parametric.change_regression import ChangeRegression
from idim_iv_ros.diagnosis.parametric.contrast import (
    Contrast,
    OneSetTest,
    PooledRows,
    with_own_parameters,
)
from idim_iv_ros.diagnosis.parametric.evidence import ParametricCause, causes_of
from idim_iv_ros.diagnosis.parametric.hypotheses import Hypothesis
from idim_iv_ros.diagnosis.parametric.selection import smallest_set
from idim_iv_ros.diagnosis.structural.likelihood import Columns, Regression
from idim_iv_ros.effects.parametric_effect import ParametricEffect
from idim_iv_ros.types import FloatArray, IntArray

NULL = "one set of base parameters holds for both sets of recordings"


@dataclass(frozen=True)
class ParametricDifference:
    """One parametric cause, held by blocks of time that were not fitted.

    Attributes
    ----------
    cause : ParametricCause
        `changes` are second set less reference.
    recordings : tuple of int
        Of the second set, for which it holds.
    columns : Columns
        Rows (r_j, m) of its changes.
    torques : tuple of (r_j,)
        What it adds, N m (N); zero outside these recordings.
    gains : tuple of float
        What each block of these recordings gains by it.
    """

    cause: ParametricCause
    recordings: tuple[int, ...]
    columns: Columns
    torques: tuple[FloatArray, ...]
    gains: tuple[float, ...]


@dataclass(frozen=True)
class ParametricDifferences:
    """Outcome for the whole second set.

    Attributes
    ----------
    test : OneSetTest
        Of the second set against the reference, beside effects that differ.
    rejected : bool
        Whether the test, blocks of time and the size of the difference speak against one set.
    differences : tuple of ParametricDifference
        Strongest first.
    groups : tuple of tuple of int
        Recordings of the second set that agree with one another.
    reference_disagrees : tuple of int
        Recordings of the reference that differ from the others of it.
    closest : tuple of Hypothesis
        Where nothing is named: causes that explain most of the difference, none of whose numbers
        is sure.
    """

    test: OneSetTest
    rejected: bool
    differences: tuple[ParametricDifference, ...]
    groups: tuple[tuple[int, ...], ...]
    reference_disagrees: tuple[int, ...]
    closest: tuple[Hypothesis, ...] = ()


def parametric_differences(
    sets: TwoSets,
    structural: StructuralOutcome,
    catalogue: Sequence[ParametricEffect],
    blocks: Sequence[IntArray],
) -> ParametricDifferences:
    """Name what differs in the parameters, for each group of recordings that agree."""
    regression = beside_effects(sets, structural)
    fit = structural.fit
    whole = PooledRows(sets.data, regression, fit).contrast(sets.second)
    test = whole.test(settings.AGREEMENT_LEVEL, NULL)
    groups, apart = _groups(sets, regression, structural, catalogue)
    rejected = _rejected(test)
    found: list[ParametricDifference] = []
    closest: list[Hypothesis] = []
    if rejected or len(groups) > 1:
        slow = replace(fit, noise_models=tuple(slow_noise(each) for each in fit.noise_models))
        for group in groups:
            others = regression
            for other in groups:
                if other is not group:
                    others = with_own_parameters_beside(sets, others, other)
            rows = PooledRows(sets.data, others, slow).contrast(group)
            kept = smallest_set(rows.changes, rows.changes.refit(), catalogue)
            named = _named(sets, structural, others, rows, group, kept, catalogue, blocks)
            found += named
            closest += [] if named else kept
    return ParametricDifferences(test, rejected, tuple(found), groups, apart, tuple(closest))


def beside_effects(sets: TwoSets, structural: StructuralOutcome) -> Regression:
    """One set of base parameters, and all effects that were found."""
    regression = sets.regression
    for each in structural.common:
        regression = regression.with_columns(each.candidate.columns)
    for difference in (*structural.differences, *structural.unattributed):
        regression = regression.with_columns(difference.found.candidate.columns)
    return regression


def with_own_parameters_beside(
    sets: TwoSets, regression: Regression, second: Collection[int]
) -> Regression:
    """Add base parameters of their own for some recordings to a regression that has effects."""
    own = with_own_parameters(sets.data, sets.regression, second)
    assert own.block is not None
    return regression.with_columns(own.block)


def _rejected(test: OneSetTest) -> bool:
    return (
        test.hypothesis.accepted is False
        and test.folds_positive >= settings.AGREEMENT_LEAST_FOLDS
        and float(test.shares.max()) >= settings.CONTRAST_LEAST_SHARE
    )


def _groups(
    sets: TwoSets,
    regression: Regression,
    structural: StructuralOutcome,
    catalogue: Sequence[ParametricEffect],
) -> tuple[tuple[tuple[int, ...], ...], tuple[int, ...]]:
    """Recordings of the second set that agree, and those of the reference that do not."""
    own = with_own_parameters_beside(sets, regression, sets.second)
    fit = own.fit(structural.fit.noise_models)
    found = agreement_beside(sets.data, own, fit, catalogue)
    differing = {each.recording for each in found.differences if each.causes}
    alone = sorted(differing & sets.second)
    rest = tuple(sorted(sets.second - differing))
    groups = ((rest,) if rest else ()) + tuple((number,) for number in alone)
    return groups, tuple(sorted(differing - sets.second))


def _named(
    sets: TwoSets,
    structural: StructuralOutcome,
    regression: Regression,
    rows: Contrast,
    group: tuple[int, ...],
    tried: Sequence[Hypothesis],
    catalogue: Sequence[ParametricEffect],
    blocks: Sequence[IntArray],
) -> list[ParametricDifference]:
    """Causes that blocks of time support; one that they do not is left out, and all estimated."""
    changes, joints, kept = rows.changes, sets.data.joints, list(tried)
    own = [
        np.unique(block[inside])
        for block, inside in zip(blocks, rows.inside, strict=True)
        if inside.any()
    ]
    numbers = np.unique(np.concatenate(own))
    while kept:
        causes = causes_of(joints, changes, kept, catalogue)
        columns = [_columns(changes, cause) for cause in causes]
        whole = block_errors(_with(regression, columns), structural.fit.noise_models, blocks)
        gains = [
            block_errors(
                _with(regression, [each for each in columns if each is not this]),
                structural.fit.noise_models,
                blocks,
            ).losses[numbers]
            - whole.losses[numbers]
            for this in columns
        ]
        unsure = [place for place, each in enumerate(gains) if not clearly_better(each)]
        if not unsure:
            return _differences(changes, causes, columns, gains, group)
        # One at a time: what another one imitates may be needed once that is gone.
        least = min(unsure, key=lambda place: float(gains[place].sum()))
        kept = [
            Hypothesis(
                cause.effect,
                None if cause.joint is None else joints.index(cause.joint),
                cause.changes,
            )
            for place, cause in enumerate(causes)
            if place != least
        ]
    return []


def _columns(changes: ChangeRegression, cause: ParametricCause) -> dict[int, FloatArray]:
    directions = np.column_stack([change.direction for change in cause.changes])
    return {joint: unit @ directions for joint, unit in enumerate(changes.columns)}


def _with(regression: Regression, columns: Sequence[Columns]) -> Regression:
    for each in columns:
        regression = regression.with_columns(each)
    return regression


def _differences(
    changes: ChangeRegression,
    causes: Sequence[ParametricCause],
    columns: Sequence[Columns],
    gains: Sequence[FloatArray],
    group: tuple[int, ...],
) -> list[ParametricDifference]:
    explained = changes.explain([change for cause in causes for change in cause.changes])
    start, found = 0, []
    for cause, own, gain in zip(causes, columns, gains, strict=True):
        stop = start + len(cause.changes)
        contribution = explained.contributions[:, start:stop].sum(axis=1)
        start = stop
        found.append(
            ParametricDifference(
                cause,
                group,
                own,
                tuple(unit @ contribution for unit in changes.columns),
                tuple(map(float, gain)),
            )
        )
    return found
