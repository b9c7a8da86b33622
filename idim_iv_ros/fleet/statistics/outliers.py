"""Which robots of a type differ from the others, and in which quantities.

Each robot is held against the others without it (externally studentised). Robots that differ widen
the scatter of the others and hide each other, so those that were called are left out of what the
rest is held against, and all are judged again, until the same ones are called. The first to be left
out are far from the median, by a scatter that a minority cannot move; a fleet in which nobody
differs ends with nobody left out, and then each test is exact for normal robots of equal variance:
Student's t with k − 2 degrees of freedom.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from idim_iv_ros.fleet.statistics.multiplicity import FALSE_DISCOVERIES, choose
from idim_iv_ros.fleet.statistics.random_effects import between_variance, generalised_q
from idim_iv_ros.types import FloatArray

LEAST = 4  # robots of a type, below which nothing says what is ordinary
_FAR = 3.0  # deviations from the median, of those left out at first
_ROUNDS = 12
_HALVINGS = 80
_MEDIAN = float(scipy.stats.chi2.median(1))


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
    """Judge the robots of all types together at one false discovery rate.

    Where rounds do not settle, what was called in the last two of them counts.
    """
    left_out = [_far(each) for each in populations]
    seen: list[bytes] = []
    found: list[Outlying] = []
    for _ in range(_ROUNDS):
        found = _judged(populations, left_out, level)
        left_out = [each.entries for each in found]
        state = b"".join(each.tobytes() for each in left_out)
        if state in seen:
            break
        seen.append(state)
    return found


def _judged(
    populations: Sequence[Population], left_out: Sequence[NDArray[np.bool_]], level: float
) -> list[Outlying]:
    tested = [
        _against_others(each, apart) for each, apart in zip(populations, left_out, strict=True)
    ]
    widest = max((p.shape[1] for _, p in tested), default=0)
    padded = [
        np.pad(p, ((0, 0), (0, widest - p.shape[1])), constant_values=np.nan) for _, p in tested
    ]
    if not padded:
        return []
    chosen = choose(np.vstack(padded), level)
    found, first = [], 0
    for statistics, p_values in tested:
        rows = slice(first, first + len(p_values))
        found.append(
            Outlying(
                statistics,
                p_values,
                chosen.units[rows],
                chosen.p_values[rows],
                chosen.entries[rows, : p_values.shape[1]],
            )
        )
        first += len(p_values)
    return found


def _far(population: Population) -> NDArray[np.bool_]:
    """Robots far from the median, (k, m), by a scatter of which a half decides."""
    values, variances = population.values, population.variances
    if len(values) < LEAST:
        return np.zeros(values.shape, dtype=bool)
    known = np.isfinite(values) & np.isfinite(variances)
    centre = np.array(
        [np.median(v[k]) if k.any() else np.nan for v, k in zip(values.T, known.T, strict=True)]
    )
    squares = (values - centre) ** 2
    low, high = (
        np.zeros(values.shape[1]),
        np.nan_to_num(np.nanmax(np.where(known, squares, 0.0), axis=0)) / _MEDIAN,
    )
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        ratios = np.where(
            known, squares / (np.where(known, variances, 1.0) + middle + 1e-300), np.nan
        )
        medians = np.array(
            [np.median(r[k]) if k.any() else 0.0 for r, k in zip(ratios.T, known.T, strict=True)]
        )
        low, high = (
            np.where(medians > _MEDIAN, middle, low),
            np.where(medians > _MEDIAN, high, middle),
        )
    scatter = np.where(known, variances, np.nan) + high
    return np.asarray(known & (np.where(known, squares, 0.0) > _FAR**2 * scatter))


def _against_others(
    population: Population, left_out: NDArray[np.bool_]
) -> tuple[FloatArray, FloatArray]:
    """Studentised distances (k, m) and their p-values."""
    values, variances = population.values, population.variances
    statistics = np.full(values.shape, np.nan)
    p_values = np.full(values.shape, np.nan)
    kept = np.where(left_out, np.nan, values)
    for robot in range(len(values)):
        others = np.delete(kept, robot, axis=0)
        own = np.delete(variances, robot, axis=0)
        count = np.isfinite(others + own).sum(axis=0)
        between = between_variance(others, own)
        _, mean, uncertainty = generalised_q(others, own, between)
        usable = (count >= LEAST - 1) & np.isfinite(values[robot] + variances[robot])
        with np.errstate(invalid="ignore", divide="ignore"):
            deviation = np.sqrt(variances[robot] + between + uncertainty)
            distance = (values[robot] - mean) / deviation
        statistics[robot, usable] = distance[usable]
        tail = 2.0 * scipy.stats.t.sf(np.abs(distance), np.maximum(count - 1, 1))
        p_values[robot, usable] = tail[usable]
    return statistics, p_values
