"""Which robots of a type differ from the others, and in which quantities.

Robots that differ widen the scatter of the others and hide each other. So the robot farthest from
the others is taken out, then the farthest of the rest, until a third is out; each is held against
those that are still there (externally studentised). A robot's p-value is the smallest of its own
and of those taken out after it: if one of these differs, so does a robot that is farther out
(generalised extreme studentised deviate: Rosner, Technometrics 25, 1983). It is calibrated with
fleets in which nobody differs: the p-value that counts is how often it would be as small there.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import scipy
from numpy.typing import NDArray

from idim_iv_ros.fleet.statistics.multiplicity import FALSE_DISCOVERIES, choose
from idim_iv_ros.fleet.statistics.random_effects import between_variance, generalised_q
from idim_iv_ros.types import FloatArray

LEAST = 4  # robots of a type, below which nothing says what is ordinary
_MOST = 3  # one in so many robots may differ in a quantity
_DRAWN = 30000  # robots of fleets in which nobody differs, from which p-values are calibrated
_SEED = 3
_TAIL = 20  # of these with a smaller p-value; beyond, both fall in proportion


@dataclass(frozen=True)
class Population:
    """The robots of one type.

    Attributes
    ----------
    values, variances : (k, m)
        NaN where a robot has no estimate.
    """

    values: FloatArray
    variances: FloatArray


@dataclass(frozen=True)
class Outlying:
    """Outcome for one type.

    Attributes
    ----------
    statistics : (k, m)
        Studentised distance from the others.
    p_values : (k, m)
    robots : (k,) bool
    robot_p_values : (k,)
    entries : (k, m) bool
        Quantities in which a called robot differs.
    """

    statistics: FloatArray
    p_values: FloatArray
    robots: NDArray[np.bool_]
    robot_p_values: FloatArray
    entries: NDArray[np.bool_]


def outlying(populations: Sequence[Population], level: float = FALSE_DISCOVERIES) -> list[Outlying]:
    """Judge the robots of all types together at one false discovery rate."""
    if not populations:
        return []
    tested = [_p_values(each) for each in populations]
    widest = max(p_values.shape[1] for p_values in tested)
    padded = [np.pad(p, ((0, 0), (0, widest - p.shape[1])), constant_values=np.nan) for p in tested]
    chosen = choose(np.vstack(padded), level)
    found, first = [], 0
    for population, p_values in zip(populations, tested, strict=True):
        rows = slice(first, first + len(p_values))
        first += len(p_values)
        entries = chosen.entries[rows, : p_values.shape[1]]
        statistics = _against_others(population, entries)
        found.append(
            Outlying(statistics, p_values, chosen.units[rows], chosen.p_values[rows], entries)
        )
    return found


def _p_values(population: Population) -> FloatArray:
    """Calibrated p-values (k, m); NaN where nothing can be judged."""
    raw = _taken_out(population.values, population.variances)
    counts = np.isfinite(raw).sum(axis=0)
    found = np.full(raw.shape, np.nan)
    for column in np.flatnonzero(counts >= LEAST):
        judged = np.isfinite(raw[:, column])
        drawn = _nobody_differs(int(counts[column]))
        ranks = np.searchsorted(drawn, raw[judged, column], side="right")
        share = (ranks + 1.0) / (len(drawn) + 1.0)
        small = raw[judged, column] * (_TAIL / len(drawn)) / drawn[_TAIL - 1]
        found[judged, column] = np.where(ranks < _TAIL, small, share)
    return found


@lru_cache(maxsize=32)
def _nobody_differs(robots: int) -> FloatArray:
    """Sorted p-values before calibration, of robots of normal fleets of this size."""
    fleets = max(_DRAWN // robots, 100)
    values = np.random.default_rng([_SEED, robots]).standard_normal((robots, fleets))
    return np.sort(_taken_out(values, np.full(values.shape, 1e-9)), axis=None)


def _taken_out(values: FloatArray, variances: FloatArray) -> FloatArray:
    """Smallest p-value of each robot and of those that are nearer to the others, (k, m)."""
    known = np.isfinite(values) & np.isfinite(variances)
    left = np.where(known, values, np.nan)
    counts = known.sum(axis=0)
    columns = np.arange(values.shape[1])
    steps = np.maximum(counts // _MOST, 1)
    order, found = [], []
    for step in range(int(steps.max(initial=0))):
        between = between_variance(left, variances)
        _, mean, _ = generalised_q(left, variances, between)
        with np.errstate(invalid="ignore", divide="ignore"):
            distances = np.abs(left - mean) / np.sqrt(variances + between)
        farthest = np.argmax(np.where(np.isfinite(distances), distances, -1.0), axis=0)
        own = left[farthest, columns]
        left[farthest, columns] = np.nan
        p_value = _beside(own, variances[farthest, columns], left, variances)
        order.append(farthest)
        found.append(np.where((step < steps) & (counts - step >= LEAST), p_value, np.inf))
    result = np.where(known & (counts >= LEAST), 1.0, np.nan)
    smallest = np.full(values.shape[1], np.inf)
    for farthest, p_value in zip(reversed(order), reversed(found), strict=True):
        smallest = np.minimum(smallest, p_value)
        inside = np.isfinite(result[farthest, columns]) & np.isfinite(smallest)
        result[farthest[inside], columns[inside]] = smallest[inside]
    return result


def _beside(
    own: FloatArray, variance: FloatArray, others: FloatArray, variances: FloatArray
) -> FloatArray:
    """p-values (m,) of one robot beside others."""
    distance = _distance(own, variance, others, variances)
    count = np.isfinite(others + variances).sum(axis=0)
    tail = 2.0 * scipy.stats.t.sf(np.abs(distance), np.maximum(count - 1, 1))
    return np.where(np.isfinite(tail), tail, np.inf)


def _distance(
    own: FloatArray, variance: FloatArray, others: FloatArray, variances: FloatArray
) -> FloatArray:
    """Studentised distance (m,) of one robot from others."""
    between = between_variance(others, variances)
    _, mean, uncertainty = generalised_q(others, variances, between)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray((own - mean) / np.sqrt(variance + between + uncertainty))


def _against_others(population: Population, left_out: NDArray[np.bool_]) -> FloatArray:
    """Studentised distances (k, m) of each robot from the others that were not called."""
    values, variances = population.values, population.variances
    statistics = np.full(values.shape, np.nan)
    kept = np.where(left_out, np.nan, values)
    for robot in range(len(values)):
        others, own = np.delete(kept, robot, axis=0), np.delete(variances, robot, axis=0)
        usable = np.isfinite(others + own).sum(axis=0) >= LEAST - 1
        distance = _distance(values[robot], variances[robot], others, own)
        statistics[robot, usable] = distance[usable]
    return statistics
