"""Structural effects that both sets have, and those by which they differ, in one search.

Every effect competes in three scopes: common to both sets, in the reference alone, in the second
set alone. What both have is explained best by common coefficients and cancels; looked for in the
reference alone it would have to be seen there, and on all rows together an effect of one set would
pass for half an effect of both. The base parameters of each set are free beside them.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.against.blocks import BlockErrors, block_errors, clearly_better
from idim_iv_ros.diagnosis.against.scoped import (
    Scope,
    ScopedGrids,
    only_in,
    plain_name,
    scope_of,
)
from idim_iv_ros.diagnosis.against.sets import TwoSets
from idim_iv_ros.diagnosis.parametric.contrast import with_own_parameters
from idim_iv_ros.diagnosis.parametric.errors_beyond_base import ERRORS_BEYOND_BASE
from idim_iv_ros.diagnosis.structural.attribution import Found, attribute
from idim_iv_ros.diagnosis.structural.candidate import rows_of
from idim_iv_ros.diagnosis.structural.deviations import differs_from_nothing
from idim_iv_ros.diagnosis.structural.likelihood import Columns, Fit, Regression
from idim_iv_ros.diagnosis.structural.nonparametric import NONPARAMETRIC, Nonparametric
from idim_iv_ros.effects.effect import Effect
from idim_iv_ros.effects.registry import STRUCTURAL
from idim_iv_ros.progress import Progress, part_of
from idim_iv_ros.types import IntArray

SCOPES: tuple[Scope, ...] = ("both", "reference", "against")


@dataclass(frozen=True)
class StructuralDifference:
    """An effect that one of the sets has, and the other has not or has otherwise.

    Attributes
    ----------
    found : Found
    scope : Scope
        The set that has it.
    common : Columns
        The same shape in both sets: what one model for both would hold in its place.
    gains : tuple of float
        What each block of that set gains by it (negative log predictive density).
    torques : tuple of float
        What it takes of each joint's residual in that set, root of the energy, N m (N), on blocks
        that were not fitted: base parameters imitate the rest of its torque.
    """

    found: Found
    scope: Scope
    common: Columns
    gains: tuple[float, ...]
    torques: tuple[float, ...]

    @property
    def effect(self) -> str:
        """Name in the catalogue."""
        return plain_name(self.found.candidate.effect.name)


@dataclass(frozen=True)
class StructuralOutcome:
    """What the search found.

    Attributes
    ----------
    common : tuple of Found
        In both sets, with the same coefficients.
    differences : tuple of StructuralDifference
        Named, and held by blocks of time that were not fitted.
    unattributed : tuple of StructuralDifference
        The same outside the catalogue: a flexible function explains more than any effect does.
    tried : int
        Shapes that were tried at first.
    fit : Fit
        Of everything that was found, each set with base parameters of its own.
    """

    common: tuple[Found, ...]
    differences: tuple[StructuralDifference, ...]
    unattributed: tuple[StructuralDifference, ...]
    tried: int
    fit: Fit


def scoped_catalogue(sets: TwoSets, without: Collection[str]) -> list[Effect]:
    """Every effect and nonparametric alternative in every scope."""
    effects = [
        effect
        for effect in (*STRUCTURAL, *ERRORS_BEYOND_BASE, *NONPARAMETRIC)
        if effect.name not in without
    ]
    first = len(sets.sets[0].motions)
    motions = {
        "both": sets.data.motions,
        "reference": sets.data.motions[:first],
        "against": sets.data.motions[first:],
    }
    return [
        effect if scope == "both" else only_in(effect, scope, motions[scope])
        for scope in SCOPES
        for effect in effects
    ]


def structural_differences(
    sets: TwoSets,
    without: Collection[str],
    blocks: Sequence[IntArray],
    progress: Progress | None = None,
) -> StructuralOutcome:
    """Look for effects in all scopes, and keep those differences that held-out blocks support.

    Parameters
    ----------
    without
        Effects that are left out of the catalogue.
    blocks
        See `time_blocks_of`.
    """
    data = sets.data
    catalogue = scoped_catalogue(sets, without)
    current = with_own_parameters(data, sets.regression, sets.second)
    found: list[Found] = []
    grids, tried = ScopedGrids(sets.inside), 0
    for turn in range(settings.CONTRAST_ROUNDS):
        share = turn / settings.CONTRAST_ROUNDS
        part = part_of(progress, share, share + 1.0 / settings.CONTRAST_ROUNDS)
        step = attribute(data, current, catalogue, part, grids)
        tried = tried or step.tried
        found += step.found
        current = step.extended
        if len(step.found) < settings.MOST_EFFECTS:
            break
    return _confirmed(sets, found, tried, blocks)


def _confirmed(
    sets: TwoSets, found: Sequence[Found], tried: int, blocks: Sequence[IntArray]
) -> StructuralOutcome:
    """Keep differences that predict held-out blocks better than nothing, and than a common effect.

    One is dropped at a time, the last accepted first: beside it another may not be needed.
    """
    base = with_own_parameters(sets.data, sets.regression, sets.second)
    kept = [each for each in found if not _beyond_base(each)]
    while True:
        regression = _with(base, kept)
        fit = regression.fit()
        whole = block_errors(regression, fit.noise_models, blocks)
        judged = [
            _judged(sets, base, kept, each, fit, whole, blocks) for each in kept if _scoped(each)
        ]
        refused = [each for each, difference in judged if difference is None]
        if not refused:
            break
        kept = [each for each in kept if each is not refused[-1]]
    sure = [difference for _, difference in judged if difference is not None]
    return StructuralOutcome(
        tuple(each for each in kept if not _scoped(each)),
        tuple(each for each in sure if not _is_nonparametric(each.found)),
        tuple(each for each in sure if _is_nonparametric(each.found)),
        tried,
        fit,
    )


def _judged(
    sets: TwoSets,
    base: Regression,
    kept: Sequence[Found],
    this: Found,
    fit: Fit,
    whole: BlockErrors,
    blocks: Sequence[IntArray],
) -> tuple[Found, StructuralDifference | None]:
    """The difference with its gains on blocks, or None where they do not support it."""
    candidate = this.candidate
    rest = [each for each in kept if each is not this]
    place = next(k for k, each in enumerate(kept) if each is this)
    regression = _with(base, kept)
    start = sum(regression.widths[: 1 + place])
    scope = scope_of(candidate.effect.name)
    if not _is_nonparametric(this) and not differs_from_nothing(
        sets.data, regression, fit, candidate, start
    ):
        return this, None
    without = block_errors(_with(base, rest), fit.noise_models, blocks)
    inside = sets.blocks_of(scope, blocks)
    gains = (without.losses - whole.losses)[inside]
    common = rows_of(sets.data, _everywhere(candidate.effect), candidate.place, [candidate.shape])
    shared = block_errors(_with(base, rest).with_columns(common[0]), fit.noise_models, blocks)
    if not clearly_better(gains) or not clearly_better(shared.losses - whole.losses):
        return this, None
    torques = _taken(sets, scope, without, whole)
    shares = [torque / size for torque, size in zip(torques, sets.data.torque_sizes, strict=True)]
    if max(shares) < settings.CONTRAST_LEAST_EFFECT:
        return this, None
    return this, StructuralDifference(this, scope, common[0], tuple(map(float, gains)), torques)


def _taken(
    sets: TwoSets, scope: Scope, without: BlockErrors, whole: BlockErrors
) -> tuple[float, ...]:
    """Root of what a model takes of the energy of each joint's residual in one set, N m (N)."""
    found = []
    for inside, before, after in zip(sets.inside, without.residuals, whole.residuals, strict=True):
        own = inside == (scope == "against")
        energy = float(np.mean(before[own] ** 2) - np.mean(after[own] ** 2))
        found.append(float(np.sqrt(max(energy, 0.0))))
    return tuple(found)


def _everywhere(effect: Effect) -> Effect:
    """Return the effect of the catalogue of which this one is a scope."""
    name = plain_name(effect.name)
    every = (*STRUCTURAL, *ERRORS_BEYOND_BASE, *NONPARAMETRIC)
    return next(each for each in every if each.name == name)


def _with(base: Regression, found: Sequence[Found]) -> Regression:
    for each in found:
        base = base.with_columns(each.candidate.columns)
    return base


def _scoped(found: Found) -> bool:
    return scope_of(found.candidate.effect.name) != "both"


def _beyond_base(found: Found) -> bool:
    """Errors of the given numbers: of one set alone they are parametric, and named as such."""
    names = {each.name for each in ERRORS_BEYOND_BASE}
    return _scoped(found) and plain_name(found.candidate.effect.name) in names


def _is_nonparametric(found: Found) -> bool:
    return isinstance(found.candidate.effect, Nonparametric)
