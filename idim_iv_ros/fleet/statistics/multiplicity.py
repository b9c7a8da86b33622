"""Many tests at once: which robots, and then which of their quantities.

Each robot has one p-value, that of Simes (Biometrika 73, 1986) over its quantities; robots are
chosen by Benjamini and Hochberg (J. R. Statist. Soc. B 57, 1995). In a chosen robot, quantities are
chosen at the level times the share of robots that were chosen, so that the false discovery rate
averaged over chosen robots keeps its level (Benjamini and Bogomolov, J. R. Statist. Soc. B 76,
2014).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from idim_iv_ros.types import FloatArray

FALSE_DISCOVERIES = 0.1  # at most, on average, of what is called different


@dataclass(frozen=True)
class Chosen:
    """Which of the tests of k units (robots) in m entries (quantities) are called."""

    p_values: FloatArray  # (k,); NaN where nothing was tested
    units: NDArray[np.bool_]  # (k,)
    entries: NDArray[np.bool_]  # (k, m), only in chosen units


def choose(groups: Sequence[FloatArray], level: float = FALSE_DISCOVERIES) -> list[Chosen]:
    """Choose units and their entries at one rate for all groups.

    A group has p-values (k, m), NaN where none was computed; k and m may differ.
    """
    simes = [np.array([_simes(row) for row in p_values]) for p_values in groups]
    units = np.concatenate([np.zeros(0), *simes])
    chosen = benjamini_hochberg(units, level)
    within = level * float(chosen.sum()) / max(int(np.isfinite(units).sum()), 1)
    result, first = [], 0
    for p_values, of_group in zip(groups, simes, strict=True):
        called = chosen[first : first + len(of_group)]
        first += len(of_group)
        entries = np.zeros(p_values.shape, dtype=bool)
        for unit in np.flatnonzero(called):
            entries[unit] = benjamini_hochberg(p_values[unit], within)
        result.append(Chosen(of_group, called, entries))
    return result


def benjamini_hochberg(p_values: FloatArray, level: float) -> NDArray[np.bool_]:
    """Which null hypotheses are rejected, (k,); NaN never is."""
    tested = np.isfinite(p_values)
    rejected = np.zeros(len(p_values), dtype=bool)
    if tested.any():
        rejected[tested] = scipy.stats.false_discovery_control(p_values[tested]) <= level
    return rejected


def _simes(p_values: FloatArray) -> float:
    """p-value of Simes for all of (m,) hypotheses together; NaN where none was tested."""
    ordered = np.sort(p_values[np.isfinite(p_values)])
    if not len(ordered):
        return float("nan")
    ranks = np.arange(1, len(ordered) + 1)
    return float(min(1.0, np.min(ordered * len(ordered) / ranks)))
