"""Whether parameters changed between two identifications, beyond what noise explains."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from statistics import NormalDist

Estimate = tuple[float, float]  # value and standard deviation


@dataclass(frozen=True)
class Drift:
    """A parameter of the last identification, compared with its first estimate.

    - `statistic`: see `in_deviations`: standard normal if the parameter has not changed
    - `limit`: what its magnitude exceeds by chance with the probability that was asked for, shared
      among all parameters (Bonferroni)
    """

    parameter: str
    value: float
    first: float
    statistic: float
    limit: float
    since: tuple[str, ...]

    @property
    def drifts(self) -> bool:
        """Whether the last estimate differs from the first by more than chance allows."""
        return abs(self.statistic) > self.limit


def drifts_of(
    first: Mapping[str, Estimate],
    last: Mapping[str, Estimate],
    significance: float,
    since: tuple[str, ...],
) -> list[Drift]:
    """Compare two independent estimates of the same parameters.

    - `first`, `last`: value and standard deviation by name, the same names in both
    - `significance`: probability that any of the parameters is flagged although none has changed
    """
    limit = largest_by_chance(significance, len(last))
    return [
        Drift(name, value, first[name][0], in_deviations(*first[name], value, std), limit, since)
        for name, (value, std) in last.items()
    ]


def largest_by_chance(significance: float, count: int) -> float:
    """Magnitude that any of `count` standard normal numbers exceeds with that probability.

    Shared among all of them (Bonferroni).
    """
    return -NormalDist().inv_cdf(significance / (2.0 * count))


def in_deviations(first: float, first_std: float, last: float, last_std: float) -> float:
    """Last less first, over the root of the sum of both variances; 0 where both are exact."""
    spread = math.hypot(first_std, last_std)
    return (last - first) / spread if spread > 0.0 else 0.0
