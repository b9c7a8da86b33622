"""Tests which robots of a type differ from the others, in which quantities.

Robots that differ widen the scatter of the others and hide each other. So the robot farthest from
the others is removed, then the farthest of the rest, until a third is removed; each is compared
with those that remain (externally studentised). A robot's p-value is the smallest of its test and
of those removed after it: if one of these differs, so does a robot that is farther out (generalised
extreme studentised deviate: Rosner, Technometrics 25, 1983). It is calibrated by simulated fleets
without outliers: as the share of their robots with a smaller p-value.

Each robot has one p-value, that of Simes (Biometrika 73, 1986) over its quantities; robots are
selected by Benjamini and Hochberg (J. R. Statist. Soc. B 57, 1995). In a selected robot, quantities
are selected at the level times the share of selected robots, so that the false discovery rate
averaged over selected robots keeps its level (Benjamini and Bogomolov, J. R. Statist. Soc. B 76,
2014).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import scipy

from idim_iv_ros.fleet.statistics.random_effects import between_variance, generalised_q
from idim_iv_ros.types import BoolArray, FloatArray

FALSE_DISCOVERIES = 0.1  # at most, on average, of what is called different
LEAST = 4  # robots of a type, below which nothing says what is ordinary
_MOST = 3  # one in so many robots may differ in a quantity
_DRAWN = 30000  # robots of fleets in which nobody differs, from which p-values are calibrated
_SEED = 3
_TAIL = 20  # of these with a smaller p-value; beyond, both fall in proportion


@dataclass(frozen=True)
class Chosen:
    """Rejected null hypotheses of k units (robots) in m entries (quantities)."""

    p_values: FloatArray  # (k,); NaN where nothing was tested
    units: BoolArray  # (k,)
    entries: BoolArray  # (k, m), only in chosen units


def choose(groups: Sequence[FloatArray]) -> list[Chosen]:
    """Select units, and entries of selected units, at the false discovery rate of the fleet.

    A group has p-values (k, m), NaN where none was computed; k and m may differ.
    """
    simes = []  # p-values of all quantities of a unit together
    for p_values in groups:
        ordered = np.sort(p_values, axis=1)  # NaN last
        counts = np.isfinite(ordered).sum(axis=1, keepdims=True)
        ranks = np.arange(1, p_values.shape[1] + 1)
        smallest = np.min(ordered * counts / ranks, axis=1, initial=np.inf, where=ranks <= counts)
        simes.append(np.where(counts[:, 0] > 0, np.minimum(smallest, 1.0), np.nan))
    units = np.concatenate([np.zeros(0), *simes])
    chosen = _adjusted(units) <= FALSE_DISCOVERIES
    within = FALSE_DISCOVERIES * float(chosen.sum()) / max(int(np.isfinite(units).sum()), 1)
    ends = np.cumsum([len(of_group) for of_group in simes])
    result = []
    for p_values, of_group, end in zip(groups, simes, ends, strict=True):
        called = chosen[end - len(of_group) : end]
        entries = np.zeros(p_values.shape, dtype=bool)
        for unit in np.flatnonzero(called):
            entries[unit] = _adjusted(p_values[unit]) <= within
        result.append(Chosen(of_group, called, entries))
    return result


def _adjusted(p_values: FloatArray) -> FloatArray:
    """Return p-values (m,) adjusted by Benjamini and Hochberg; NaN where there is none."""
    adjusted, tested = np.full(len(p_values), np.nan), np.isfinite(p_values)
    adjusted[tested] = scipy.stats.false_discovery_control(p_values[tested])
    return adjusted


@dataclass(frozen=True)
class Outlying:
    """Comparison of the k robots of a type with the others, in m quantities."""

    statistics: FloatArray  # (k, m), studentised distance from the others
    p_values: FloatArray  # (k, m)
    chosen: Chosen  # robots that differ, and the quantities in which they do


def outlying(types: Sequence[tuple[FloatArray, FloatArray]]) -> list[Outlying]:
    """Test the robots of all types at one false discovery rate.

    A type has values (k, m) and variances (k, m) of its robots, NaN where one has no estimate.
    """
    tested = [_p_values(values, variances) for values, variances in types]
    return [
        Outlying(_distances(*robots, chosen.entries), p_values, chosen)
        for robots, p_values, chosen in zip(types, tested, choose(tested), strict=True)
    ]


def _p_values(values: FloatArray, variances: FloatArray) -> FloatArray:
    raw = _stepwise_p_values(values, variances)
    counts = np.isfinite(raw).sum(axis=0)
    result = np.full(raw.shape, np.nan)
    for column in np.flatnonzero(counts >= LEAST):
        tested = np.isfinite(raw[:, column])
        drawn = _null_p_values(int(counts[column]))
        ranks = np.searchsorted(drawn, raw[tested, column], side="right")
        share = (ranks + 1.0) / (len(drawn) + 1.0)
        small = raw[tested, column] * (_TAIL / len(drawn)) / drawn[_TAIL - 1]
        result[tested, column] = np.where(ranks < _TAIL, small, share)
    return result


@lru_cache(maxsize=32)
def _null_p_values(robots: int) -> FloatArray:
    """Return sorted p-values before calibration, of simulated fleets without outliers."""
    fleets = max(_DRAWN // robots, 100)
    values = np.random.default_rng([_SEED, robots]).standard_normal((robots, fleets))
    return np.sort(_stepwise_p_values(values, np.full(values.shape, 1e-9)), axis=None)


def _stepwise_p_values(values: FloatArray, variances: FloatArray) -> FloatArray:
    """Return p-values (k, m) of values and variances (k, m) before they are calibrated."""
    estimated = np.isfinite(values) & np.isfinite(variances)
    remaining = np.where(estimated, values, np.nan)
    counts = estimated.sum(axis=0)
    columns = np.arange(values.shape[1])
    steps = np.maximum(counts // _MOST, 1)
    order, tails = [], []
    for step in range(int(steps.max(initial=0))):
        between = between_variance(remaining, variances)
        _, mean, _ = generalised_q(remaining, variances, between)
        with np.errstate(invalid="ignore", divide="ignore"):
            distances = np.abs(remaining - mean) / np.sqrt(variances + between)
        farthest = np.argmax(np.where(np.isfinite(distances), distances, -1.0), axis=0)
        value = remaining[farthest, columns]
        remaining[farthest, columns] = np.nan
        distance = _distance(value, variances[farthest, columns], remaining, variances)
        others = np.isfinite(remaining + variances).sum(axis=0)
        tail = 2.0 * scipy.stats.t.sf(np.abs(distance), np.maximum(others - 1, 1))
        tested = (step < steps) & (counts - step >= LEAST) & np.isfinite(tail)
        order.append(farthest)
        tails.append(np.where(tested, tail, np.inf))
    result = np.where(estimated & (counts >= LEAST), 1.0, np.nan)
    smallest = np.full(values.shape[1], np.inf)
    for farthest, p_value in zip(reversed(order), reversed(tails), strict=True):
        smallest = np.minimum(smallest, p_value)
        inside = np.isfinite(result[farthest, columns]) & np.isfinite(smallest)
        result[farthest[inside], columns[inside]] = smallest[inside]
    return result


def _distance(
    value: FloatArray, variance: FloatArray, others: FloatArray, variances: FloatArray
) -> FloatArray:
    """Return the studentised distance (m,) of a robot's values (m,) from `others` (k, m)."""
    between = between_variance(others, variances)
    _, mean, uncertainty = generalised_q(others, variances, between)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray((value - mean) / np.sqrt(variance + between + uncertainty))


def _distances(values: FloatArray, variances: FloatArray, left_out: BoolArray) -> FloatArray:
    """Return studentised distances (k, m) of robots from the others, without those left out."""
    statistics = np.full(values.shape, np.nan)
    ordinary = np.where(left_out, np.nan, values)
    for robot in range(len(values)):
        others, spread = np.delete(ordinary, robot, axis=0), np.delete(variances, robot, axis=0)
        usable = np.isfinite(others + spread).sum(axis=0) >= LEAST - 1
        distance = _distance(values[robot], variances[robot], others, spread)
        statistics[robot, usable] = distance[usable]
    return statistics
