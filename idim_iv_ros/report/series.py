"""Time series thinned for a plot, and where they have gaps."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from idim_iv_ros.identification.result import JointSeries
from idim_iv_ros.report.session_axis import SessionAxis
from idim_iv_ros.types import FloatArray

_BUCKETS = 700


@dataclass(frozen=True)
class PlotSeries:
    """A joint's torque for a plot; NaN where lines are interrupted.

    Attributes
    ----------
    time, measured, predicted, residual : (m,)
        s on the axis and the unit of the torque.
    gaps : (k, 2) s
        Start and end of each stretch of a recording without rows that is wide enough to be seen.
    """

    time: FloatArray
    measured: FloatArray
    predicted: FloatArray
    residual: FloatArray
    gaps: FloatArray


def thin(series: JointSeries, session: SessionAxis) -> PlotSeries:
    """Thin a long series without losing its peaks, and interrupt it at its gaps.

    Each of some hundred equal pieces keeps the rows where the measured torque and the residual
    are smallest and largest. Gaps narrower than a thousandth of the session are not shown, those
    between recordings always are.
    """
    time, measured = session.on_axis(np.asarray(series.time)), np.asarray(series.measured)
    residual = measured - np.asarray(series.predicted)
    if len(time) < 2:
        none = np.zeros((0, 2))
        return PlotSeries(time, measured, np.asarray(series.predicted), residual, none)
    step = float(np.median(np.diff(time)))
    widest = max(1.5 * step, (time[-1] - time[0]) / 1000.0)
    inside = np.flatnonzero(np.diff(time) > widest)
    borders = session.ends(np.asarray(series.time))
    inside = np.setdiff1d(inside, borders)
    ends = np.union1d(inside, borders)
    chosen = np.union1d(peaks([measured, residual]), np.concatenate([ends, ends + 1]))
    breaks = np.searchsorted(chosen, ends) + 1

    def broken(values: FloatArray) -> FloatArray:
        return np.insert(values[chosen].astype(float), breaks, np.nan)

    return PlotSeries(
        broken(time),
        broken(measured),
        broken(np.asarray(series.predicted)),
        broken(residual),
        np.column_stack([time[inside], time[inside + 1]]),
    )


def contiguous_runs(series: JointSeries, session: SessionAxis) -> list[slice]:
    """Return the rows of one recording that follow each other without a gap, as slices."""
    steps = np.diff(np.asarray(series.time))
    if len(steps) == 0:
        return [slice(0, len(series.time))] if len(series.time) else []
    gaps = np.flatnonzero(steps > 1.5 * np.median(steps))
    cuts = np.union1d(gaps, session.ends(np.asarray(series.time))) + 1
    bounds = [0, *cuts.tolist(), len(series.time)]
    return [slice(first, last) for first, last in itertools.pairwise(bounds)]


def peaks(curves: Sequence[FloatArray], buckets: int = _BUCKETS) -> NDArray[np.int64]:
    """Return the rows that a plot of these curves needs.

    Each of `buckets` equal pieces keeps the rows where a curve is smallest and largest; a short
    series is kept whole.
    """
    count = len(curves[0])
    if count <= 4 * buckets:
        return np.arange(count)
    bounds = np.linspace(0, count, buckets + 1).astype(int)
    chosen: list[Any] = [0, count - 1]
    for first, last in itertools.pairwise(bounds):
        for curve in curves:
            values = curve[first:last]
            chosen += [first + int(np.argmin(values)), first + int(np.argmax(values))]
    return np.unique(chosen)


def interrupted(
    time: FloatArray,
    values: FloatArray,
    chosen: NDArray[np.int64],
    step: float,
    session: SessionAxis,
) -> tuple[FloatArray, FloatArray]:
    """Return chosen rows of a curve with NaN where rows are further apart than `step`.

    Gaps narrower than a thousandth of the session are drawn through, except between recordings.
    """
    borders = session.ends(time)
    time = session.on_axis(time)
    if len(time) < 2:
        return time, values
    widest = max(1.5 * step, (time[-1] - time[0]) / 1000.0)
    ends = np.union1d(np.flatnonzero(np.diff(time) > widest), borders)
    rows = np.union1d(chosen, np.concatenate([ends, ends + 1]))
    breaks = np.searchsorted(rows, ends) + 1
    return (
        np.insert(time[rows].astype(float), breaks, np.nan),
        np.insert(values[rows].astype(float), breaks, np.nan),
    )
