"""Whether parameters changed between two identifications, beyond what noise explains."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from statistics import NormalDist

Estimate = tuple[float, float]  # value and standard deviation


@dataclass(frozen=True)
class Drift:
    """A parameter in two independent estimates.

    - `limit`: what the magnitude of `statistic` exceeds by chance with the probability that was
      asked for, shared among all parameters (Bonferroni)
    """

    name: str
    before: float
    before_std: float
    now: float
    now_std: float
    limit: float

    @property
    def statistic(self) -> float:
        """See `in_deviations`: standard normal if the parameter has not changed."""
        return in_deviations(self.before, self.before_std, self.now, self.now_std)

    @property
    def drifts(self) -> bool:
        """Whether the estimates differ by more than chance allows."""
        return abs(self.statistic) > self.limit


def drifts_of(
    first: Mapping[str, Estimate], last: Mapping[str, Estimate], significance: float
) -> tuple[Drift, ...]:
    """Compare two independent estimates of the same parameters.

    - `first`, `last`: value and standard deviation by name, the same names in both
    - `significance`: probability that any of the parameters is flagged although none has changed
    """
    limit = -NormalDist().inv_cdf(significance / (2.0 * max(len(last), 1)))
    return tuple(Drift(name, *first[name], *now, limit) for name, now in last.items())


def in_deviations(first: float, first_std: float, last: float, last_std: float) -> float:
    """Last less first, over the root of the sum of both variances; 0 where both are exact."""
    spread = math.hypot(first_std, last_std)
    return (last - first) / spread if spread > 0.0 else 0.0
