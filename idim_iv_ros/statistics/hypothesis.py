"""Tests that know their null hypothesis, the F-test, and whether parameters changed."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from statistics import NormalDist

import scipy


@dataclass(frozen=True)
class HypothesisTest:
    """The outcome of one statistical test, or the reason why it could not be run.

    - `scope`: ``"all"`` or the name of a joint
    - `statistic`, `p_value`: None where the test could not be run; `reason` then says why
    - `df`: numerator degrees of freedom (of χ² or F)
    - `df_denom`: denominator degrees of freedom of F; None for χ²
    - `max_deviation`: effect size: how far the estimate is from the null, on the test's own scale
    - `alpha`: significance level at which `accepted` is judged
    - `torque_deviation_percent`: effect size of an instrument test on the scale of the torque, or
      None
    - `accepted`: whether the null hypothesis is accepted at `alpha`, whatever is given; None if the
      test was not run
    """

    null: str
    scope: str
    statistic: float | None
    df: int | None
    df_denom: int | None
    p_value: float | None
    max_deviation: float | None = None
    alpha: float = 0.05
    reason: str | None = None
    torque_deviation_percent: float | None = None
    accepted: bool | None = None

    def __post_init__(self) -> None:
        accepted = None if self.p_value is None else bool(self.p_value >= self.alpha)
        object.__setattr__(self, "accepted", accepted)

    @classmethod
    def not_run(cls, null: str, scope: str, reason: str, alpha: float = 0.05) -> "HypothesisTest":
        """Return the value of a test that could not be run, with the reason."""
        return cls(null, scope, None, None, None, None, None, alpha, reason)


def f_test(
    null: str,
    scope: str,
    explained: tuple[float, int],
    unexplained: tuple[float, int],
    torque_deviation_percent: float | None = None,
    max_deviation: float | None = None,
) -> HypothesisTest:
    """F-test that what some directions explain is no more than noise.

    `explained`, `unexplained`: sum of squares and number of these directions, and of those that are
    left for the noise.
    """
    (gained, df), (rest, df_denom) = explained, unexplained
    statistic = gained / df / (rest / df_denom)
    p_value = float(scipy.stats.f.sf(statistic, df, df_denom))
    outcome = statistic, df, df_denom, p_value, max_deviation
    return HypothesisTest(null, scope, *outcome, torque_deviation_percent=torque_deviation_percent)


Estimate = tuple[float, float]  # value and standard deviation


@dataclass(frozen=True)
class Drift:
    """A parameter in two independent estimates.

    `limit`: what the magnitude of `statistic` exceeds by chance with the probability that was asked
    for, shared among all parameters (Bonferroni).
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
