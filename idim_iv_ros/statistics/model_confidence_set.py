"""Which of several models predict as well as the best: a model confidence set.

Source: Hansen, Lunde and Nason, "The model confidence set", Econometrica 79 (2011), 453–497: the
statistic T_max of section 3.1.2. A model leaves the set while the hypothesis that all that remain
predict equally well is rejected.
"""

from dataclasses import dataclass

import numpy as np

from idim_iv_ros.types import FloatArray

DRAWS = 2000


@dataclass(frozen=True)
class ModelConfidenceSet:
    """H0 for each model: no other model predicts better.

    Attributes
    ----------
    included : tuple of int
        Models of the set, from 0.
    p_values : (m,)
        Largest size of the test at which each model is still in the set.
    """

    included: tuple[int, ...]
    p_values: FloatArray


def model_confidence_set(
    losses: FloatArray, size: float, *, seed: int, draws: int = DRAWS
) -> ModelConfidenceSet:
    """Drop models that predict worse than the rest, until equality is no longer rejected.

    Parameters
    ----------
    losses
        (b, m) of m models on b blocks that are independent of one another; lower is better.
    size
        Of the test: the set holds the best model with probability 1 − size, for many blocks.
    seed
        Of the bootstrap over blocks.

    Raises
    ------
    ValueError
        Fewer than two blocks, or losses that are not finite.
    """
    count, models = losses.shape
    if count < 2 or not np.isfinite(losses).all():
        raise ValueError("a model confidence set needs finite losses on two blocks or more")
    random = np.random.default_rng(seed)
    weights = random.multinomial(count, np.full(count, 1.0 / count), size=draws) / count
    p_values = np.ones(models)
    remaining = list(range(models))
    largest = 0.0
    while len(remaining) > 1:
        table = _scaled(losses[:, remaining])
        differences = table - table.mean(axis=1, keepdims=True)
        mean = differences.mean(axis=0)
        drawn = weights @ differences - mean
        # Resampled blocks scatter by (b − 1) / b of what new ones would.
        deviation = np.sqrt(np.mean(drawn**2, axis=0) * count / (count - 1.0))
        deviation = np.where(deviation > 0.0, deviation, np.inf)
        statistics = mean / deviation
        null = np.max(drawn / deviation, axis=1) * np.sqrt(count / (count - 1.0))
        worst = int(np.argmax(statistics))
        largest = max(largest, float(np.mean(null >= statistics[worst])))
        p_values[remaining[worst]] = largest
        del remaining[worst]
    included = tuple(int(each) for each in np.flatnonzero(p_values >= size))
    return ModelConfidenceSet(included, p_values)


def _scaled(losses: FloatArray) -> FloatArray:
    """Losses below one: their unit decides nothing, and squares of large ones have no number.

    By a power of two, which changes no digit.
    """
    _, exponent = np.frexp(np.abs(losses).max())
    return np.asarray(np.ldexp(losses, -int(exponent)))
