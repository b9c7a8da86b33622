"""Which candidate is taken: rules that the search and its repetition without a fold share."""

from collections.abc import Sequence
from typing import Protocol, TypeVar

import numpy as np

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.parametric.errors_beyond_base import GravityError, TiltedMoments
from idim_iv_ros.diagnosis.structural.likelihood import Columns
from idim_iv_ros.diagnosis.structural.nonparametric import Nonparametric
from idim_iv_ros.effects.effect import Effect, Place, Shape
from idim_iv_ros.types import FloatArray


class Judged(Protocol):
    """What the rules ask of a candidate; see `Candidate`."""

    @property
    def effect(self) -> Effect:
        """Of the catalogue, or a nonparametric alternative."""

    @property
    def place(self) -> Place:
        """Joint, or both of a coupling."""

    @property
    def shape(self) -> Shape:
        """The one that fits best."""

    @property
    def key(self) -> tuple[str, int, int | None]:
        """Effect and place."""

    @property
    def columns(self) -> Columns:
        """By joint."""

    @property
    def gain(self) -> float:
        """Of the logarithm of the likelihood."""

    @property
    def explained(self) -> float:
        """Share of the torque gap's energy at its joints."""

    @property
    def numbers(self) -> int:
        """Coefficients and shape: what the candidate may choose."""

    @property
    def tried(self) -> int:
        """Shapes on its grid."""

    @property
    def coefficients(self) -> FloatArray:
        """(w,)."""

    @property
    def support(self) -> float:
        """Gain less the cost of numbers and search."""

    @property
    def rows(self) -> int:
        """Rows of the joints of its place."""


C = TypeVar("C", bound=Judged)


def preferred(candidates: Sequence[C]) -> C | None:
    """Return the best effect of the catalogue, unless a nonparametric alternative is far better.

    The true shape is seldom that of the catalogue: a flexible function then fits a little better
    than the right effect. It fits much better than every wrong one.
    """
    named = [each for each in candidates if not isinstance(each.effect, Nonparametric)]
    flexible = [each for each in candidates if isinstance(each.effect, Nonparametric)]
    best = max(named, key=lambda each: each.support, default=None)
    alternative = max(flexible, key=lambda each: each.support, default=None)
    if best is None or alternative is None:
        return best or alternative
    least = settings.CATALOGUE_OVER_NONPARAMETRIC * alternative.support
    least -= settings.INDISTINGUISHABLE_SUPPORT
    return best if best.support >= least else alternative


def with_most_of_gap(candidates: Sequence[C]) -> list[C]:
    """Return the acceptable candidates that explain most of the gap.

    The likelihood alone prefers what is fast and small, where there is little noise, to what is
    slow and large. That is found too, once the large is in the model.
    """
    able = [each for each in candidates if acceptable(each)]
    largest = max((each.explained for each in able), default=0.0)
    return [each for each in able if each.explained >= settings.LEAST_OF_LARGEST * largest]


def acceptable(candidate: Judged) -> bool:
    """Whether a candidate is supported and large enough to matter."""
    share = 1.0 - np.exp(-2.0 * candidate.gain / candidate.rows)
    least = settings.LEAST_SUPPORT
    if candidate.effect.of_high_derivatives:
        least = settings.LEAST_SUPPORT_OF_DERIVATIVES
    return bool(
        candidate.support >= least
        and share >= settings.LEAST_SHARE_OF_EFFECT
        and candidate.explained >= settings.LEAST_SHARE_OF_EFFECT
    )


def own_cause(candidate: Judged, accepted: Sequence[Judged]) -> bool:
    """Whether a nonparametric function is more than the misfit of an accepted effect.

    And whether first moments lie under a tilt that is accepted. The shape of an effect is never
    exactly that of the catalogue: what a flexible function of the same family explains beside it,
    or a little beside it at the same joint, is no other cause.
    """
    if isinstance(candidate.effect, TiltedMoments):
        return any(isinstance(other.effect, GravityError) for other in accepted)
    if not isinstance(candidate.effect, Nonparametric):
        return True
    for other in accepted:
        if isinstance(other.effect, Nonparametric) or not set(other.columns) & set(
            candidate.columns
        ):
            continue
        same = other.effect.family == candidate.effect.family
        least = settings.NONPARAMETRIC_BESIDE_EFFECT * other.support
        if same or candidate.support < least:
            return False
    return True
