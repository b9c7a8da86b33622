"""Time axes of sessions, and curves thinned for plots, with gaps."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from idim_iv_ros.recording.recording import SessionPart
from idim_iv_ros.report.figures import GREY, MUTED
from idim_iv_ros.types import FloatArray, IntArray

_PAUSE = 0.02  # between two recordings, of the length of all


@dataclass(frozen=True)
class SessionAxis:
    """Time axis on which recordings follow one another, with equal pauses between them.

    `parts` is empty where the recordings are unknown.
    """

    parts: tuple[SessionPart, ...] = ()

    @cached_property
    def drawn(self) -> tuple[float, ...]:
        """Return the start of each recording on the axis, s."""
        pause = _PAUSE * sum(part.duration for part in self.parts)
        lengths = (part.duration + pause for part in self.parts)
        return tuple(itertools.accumulate(lengths, initial=0.0))[:-1]

    @property
    def words(self) -> str:
        """Return a caption on the order of several recordings; empty for one."""
        if len(self.parts) < 2:
            return ""
        names = ", ".join(f"{number} {part.bag}" for number, part in enumerate(self.parts, 1))
        return (
            "Recordings follow one another in the order of their stamps, without the pauses "
            f"between them: {names}."
        )

    def ends(self, time: FloatArray) -> IntArray:
        """Return the rows after which another recording begins."""
        return np.flatnonzero(np.diff(self._recording(time)))

    def on_axis(self, time: FloatArray) -> FloatArray:
        """Return the places on the axis, s, of times (r,) of the session."""
        if not self.parts:
            return time
        shift = np.array(self.drawn) - [part.start for part in self.parts]
        return np.asarray(time + shift[self._recording(time)])

    def _recording(self, time: FloatArray) -> IntArray:
        """Return the number of the recording, from 0, of times (r,) of the session."""
        if not self.parts:
            return np.zeros(len(time), dtype=np.int64)
        starts = [part.start for part in self.parts]
        place = np.searchsorted(starts, time, side="right") - 1
        return np.asarray(np.maximum(place, 0), dtype=np.int64)

    def marks(self) -> dict[str, Any]:
        """Return plotly layout: a line with a number where each recording starts."""
        if len(self.parts) < 2:
            return {}
        line = {"type": "line", "y0": 0.0, "y1": 1.0, "yref": "paper"}
        dots = {"color": GREY, "width": 1, "dash": "dot"}
        number = {"y": 1.0, "yref": "paper", "showarrow": False, "xanchor": "left",
                  "yanchor": "bottom", "font": {"size": 10, "color": MUTED}}  # fmt: skip
        return {
            "shapes": [{**line, "x0": x, "x1": x, "line": dots} for x in self.drawn[1:]],
            "annotations": [
                {**number, "x": x, "text": f"{place}"} for place, x in enumerate(self.drawn, 1)
            ],
            "margin": {"l": 58, "r": 12, "t": 22, "b": 40},  # room for the numbers above
        }


@dataclass(frozen=True)
class Curves:
    """Thinned curves for a plot; NaN where lines are interrupted."""

    time: FloatArray  # (m,): s on the axis
    values: tuple[FloatArray, ...]  # (m,) each
    # (k, 2) s: Start and end of each stretch of a recording without rows that is wide enough
    # to be seen
    gaps: FloatArray


def curves(
    time: FloatArray,
    values: Sequence[FloatArray],
    session: SessionAxis,
    *,
    peaks_of: Sequence[FloatArray],
    step: float | None = None,
    buckets: int = 300,
) -> Curves:
    """Thin curves without losing peaks, and interrupt them where rows are missing.

    Gaps narrower than a thousandth of the session, within a recording, are drawn through.

    - `time`, `values`: (r,), s of the session, and the curves over it
    - `peaks_of`: sequence of (r,), curves whose smallest and largest rows are kept in each bucket
    - `step`: time between rows, s; the median if left out
    - `buckets`: equal pieces of a long series
    """
    borders = session.ends(time)
    place = session.on_axis(time)
    if len(place) < 2:
        return Curves(place, tuple(values), np.zeros((0, 2)))
    step = float(np.median(np.diff(place))) if step is None else step
    widest = max(1.5 * step, (place[-1] - place[0]) / 1000.0)
    inside = np.setdiff1d(np.flatnonzero(np.diff(place) > widest), borders)
    ends = np.union1d(inside, borders)
    chosen = np.union1d(peaks(peaks_of, buckets), np.concatenate([ends, ends + 1]))
    breaks = np.searchsorted(chosen, ends) + 1
    return Curves(
        np.insert(place[chosen].astype(float), breaks, np.nan),
        tuple(np.insert(value[chosen].astype(float), breaks, np.nan) for value in values),
        np.column_stack([place[inside], place[inside + 1]]),
    )


def peaks(curves: Sequence[FloatArray], buckets: int) -> NDArray[np.int64]:
    """Return the rows that a thinned plot of these curves needs.

    In each of `buckets` equal pieces these are the rows where a curve is smallest or largest; a
    short series is kept whole.
    """
    count = len(curves[0])
    if count <= 4 * buckets:
        return np.arange(count)
    bounds = np.linspace(0, count, buckets + 1).astype(int)
    chosen: list[Any] = [0, count - 1]
    for first, last in itertools.pairwise(bounds):
        for curve in curves:
            piece = curve[first:last]
            chosen += [first + int(np.argmin(piece)), first + int(np.argmax(piece))]
    return np.unique(chosen)
