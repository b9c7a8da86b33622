"""Time series thinned for a plot, and where they have gaps."""

import itertools
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from idim_iv_ros.result import JointSeries

FloatArray = NDArray[np.float64]

_BUCKETS = 700


@dataclass(frozen=True)
class PlotSeries:
    """A joint's torque for a plot; NaN where lines are interrupted.

    Attributes
    ----------
    time, measured, predicted, residual : (m,)
        s and the unit of the torque.
    gaps : (k, 2) s
        Start and end of each stretch without rows that is wide enough to be seen.
    """

    time: FloatArray
    measured: FloatArray
    predicted: FloatArray
    residual: FloatArray
    gaps: FloatArray


def thin(series: JointSeries) -> PlotSeries:
    """Thin a long series without losing its peaks, and interrupt it at its gaps.

    Each of some hundred equal pieces keeps the rows where the measured torque and the residual
    are smallest and largest. Gaps narrower than a thousandth of the recording are not shown.
    """
    time, measured = np.asarray(series.time), np.asarray(series.measured)
    residual = measured - np.asarray(series.predicted)
    if len(time) < 2:
        none = np.zeros((0, 2))
        return PlotSeries(time, measured, np.asarray(series.predicted), residual, none)
    step = float(np.median(np.diff(time)))
    widest = max(1.5 * step, (time[-1] - time[0]) / 1000.0)
    ends = np.flatnonzero(np.diff(time) > widest)
    chosen = np.union1d(_peaks(measured, residual), np.concatenate([ends, ends + 1]))
    breaks = np.searchsorted(chosen, ends) + 1

    def interrupted(values: FloatArray) -> FloatArray:
        return np.insert(values[chosen].astype(float), breaks, np.nan)

    return PlotSeries(
        interrupted(time),
        interrupted(measured),
        interrupted(np.asarray(series.predicted)),
        interrupted(residual),
        np.column_stack([time[ends], time[ends + 1]]),
    )


def contiguous_runs(series: JointSeries) -> list[slice]:
    """Return the rows that follow each other without a gap, as slices."""
    steps = np.diff(np.asarray(series.time))
    if len(steps) == 0:
        return [slice(0, len(series.time))] if len(series.time) else []
    cuts = np.flatnonzero(steps > 1.5 * np.median(steps)) + 1
    bounds = [0, *cuts.tolist(), len(series.time)]
    return [slice(first, last) for first, last in itertools.pairwise(bounds)]


def _peaks(measured: FloatArray, residual: FloatArray) -> NDArray[np.int64]:
    count = len(measured)
    if count <= 4 * _BUCKETS:
        return np.arange(count)
    bounds = np.linspace(0, count, _BUCKETS + 1).astype(int)
    chosen: list[Any] = [0, count - 1]
    for first, last in itertools.pairwise(bounds):
        for values in (measured[first:last], residual[first:last]):
            chosen += [first + int(np.argmin(values)), first + int(np.argmax(values))]
    return np.unique(chosen)
