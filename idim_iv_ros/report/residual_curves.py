"""Figure of one joint: residual over speed, position, load and distance since reversal."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from idim_iv_ros.diagnosis.result import GapSeries
from idim_iv_ros.report.figures import GREY, Figure, axis, figure, typed
from idim_iv_ros.report.numerals import round_number
from idim_iv_ros.report.smooth_curve import SmoothCurve, smooth
from idim_iv_ros.types import FloatArray

# Neither is a colour of a model: green and purple of Okabe and Ito, told apart by all readers.
FORWARD, BACKWARD = "#007a5a", "#a0457e"
_BANDS = {FORWARD: "rgba(0, 122, 90, 0.20)", BACKWARD: "rgba(160, 69, 126, 0.20)"}
_DOTS = 260  # of one direction in one panel
_ROW = 190
_GAP, _BETWEEN = 0.045, 0.05
_SHORTEST = 1e-5  # rad or m; shorter distances since a reversal are drawn there


@dataclass(frozen=True)
class Row:
    """One row of panels: the residual of one model.

    `scale`: rows with the same scale have the same range of the ordinate.
    """

    title: str
    residual: FloatArray
    scale: str


@dataclass(frozen=True)
class _Panel:
    """One column: abscissa as drawn (stretched), and its axis."""

    x: FloatArray
    axis: dict[str, Any]


def residual_figure(
    series: GapSeries, rows: list[Row], torque_unit: str, position_unit: str
) -> tuple[Figure, int]:
    """Return the figure and its height in pixels."""
    panels = _panels(series, torque_unit, position_unit)
    data: list[dict[str, Any]] = []
    axes: dict[str, Any] = {}
    limits = {row.scale: 0.0 for row in rows}
    for column, panel in enumerate(panels):
        low = column * (1.0 + _GAP) / len(panels)
        domain = [low, low + (1.0 + _GAP) / len(panels) - _GAP]
        name = "" if column == 0 else str(column + 1)
        axes[f"xaxis{name}"] = {**panel.axis, "domain": domain, "anchor": f"y{_y(len(rows), 1)}"}
        for k, row in enumerate(rows):
            traces, reach = _panel(series, panel, row, torque_unit)
            for trace in traces:
                data.append({**trace, "xaxis": f"x{name}", "yaxis": f"y{_y(k + 1, 1)}"})
            limits[row.scale] = max(limits[row.scale], reach)
    height = (1.0 - _BETWEEN * (len(rows) - 1)) / len(rows)
    for k, row in enumerate(rows):
        limit = 1.15 * limits[row.scale] or 1.0
        top = 1.0 - k * (height + _BETWEEN)
        axes[f"yaxis{_y(k + 1, 1)}"] = axis(
            f"{row.title}, {torque_unit}",
            domain=[max(top - height, 0.0), top],
            range=[-limit, limit],
            nticks=5,
            zeroline=True,
            zerolinecolor=GREY,
        )
    return figure(data, axes, hovermode="closest"), _ROW * len(rows) + 44


def _y(row: int, first: int) -> str:
    return "" if row == first else str(row)


def _panels(series: GapSeries, torque_unit: str, position_unit: str) -> list[_Panel]:
    since = np.log10(np.maximum(series.since_reversal, _SHORTEST))
    return [
        _Panel(_root(series.speed), _speed_axis(series.speed, f"{position_unit}/s")),
        _Panel(series.position, axis(f"Position, {position_unit}", nticks=6)),
        _Panel(series.load, axis(f"Load (rigid bodies), {torque_unit}", nticks=6)),
        _Panel(since, _distance_axis(since, position_unit)),
    ]


def _root(values: FloatArray) -> FloatArray:
    return np.asarray(np.sign(values) * np.sqrt(np.abs(values)))


def _speed_axis(speed: FloatArray, unit: str) -> dict[str, Any]:
    """Axis that is stretched near zero, where friction changes fastest."""
    largest = float(np.percentile(np.abs(speed), 99.5)) if len(speed) else 1.0
    ticks = _round_speeds(largest)
    values = [-each for each in reversed(ticks)] + [0.0, *ticks]
    return axis(
        f"Speed, {unit} (stretched near 0)",
        tickvals=[float(each) for each in _root(np.array(values))],
        ticktext=[round_number(each) for each in values],
        tickangle=0,
    )


def _round_speeds(largest: float) -> list[float]:
    """Round numbers up to the largest, far enough apart on the stretched axis."""
    if largest <= 0.0:
        return []
    chosen: list[float] = []
    exponent = int(np.floor(np.log10(largest)))
    for power in range(exponent, exponent - 4, -1):
        for factor in (5.0, 2.0, 1.0):
            value = factor * 10.0**power
            above = np.sqrt(chosen[0]) if chosen else np.sqrt(largest) * 1.3
            room = 0.3 * np.sqrt(largest)
            if value <= largest and above - np.sqrt(value) >= room and np.sqrt(value) >= room:
                chosen.insert(0, value)
    return chosen


def _distance_axis(since: FloatArray, unit: str) -> dict[str, Any]:
    low, high = (-3.0, 0.0) if len(since) == 0 else np.percentile(since, [1.0, 100.0])
    ticks = list(range(int(np.ceil(low)), int(np.floor(high)) + 1))
    return axis(
        f"Distance since reversal, {unit}",
        tickvals=ticks,
        ticktext=[round_number(10.0**each) for each in ticks],
        range=[float(low), float(high) + 0.03],
    )


def _panel(
    series: GapSeries, panel: _Panel, row: Row, unit: str
) -> tuple[list[dict[str, Any]], float]:
    """Traces of both directions, and how far they reach from zero."""
    traces: list[dict[str, Any]] = []
    reach = 0.0
    directions: tuple[tuple[str, str, Callable[[FloatArray], Any]], ...] = (
        ("forwards", FORWARD, lambda speed: speed > 0.0),
        ("backwards", BACKWARD, lambda speed: speed < 0.0),
    )
    for word, colour, which in directions:
        rows = np.flatnonzero(which(series.speed) & np.isfinite(row.residual))
        if len(rows) < 2:
            continue
        x, y = panel.x[rows], row.residual[rows]
        curve = smooth(x, y, series.time[rows])
        traces += [_dots(x, y, colour), *_band(curve, colour), _line(curve, colour, word, unit)]
        reach = max(reach, _reach(curve), float(np.percentile(np.abs(y), 96.0)))
    return traces, reach


def _reach(curve: SmoothCurve) -> float:
    values = np.abs(np.concatenate([curve.mean, curve.low, curve.high]))
    values = values[np.isfinite(values)]
    return float(np.percentile(values, 99.0)) if len(values) else 0.0


def _dots(x: FloatArray, y: FloatArray, colour: str) -> dict[str, Any]:
    # Drawn at random: every n-th sample of a periodic motion would always be the same place.
    count = min(_DOTS, len(x))
    chosen = np.sort(np.random.default_rng(0).choice(len(x), count, replace=False))
    return {
        "type": "scatter",
        "mode": "markers",
        "x": typed(x[chosen]),
        "y": typed(y[chosen]),
        "marker": {"color": colour, "size": 2.6, "opacity": 0.28, "line": {"width": 0}},
        "hoverinfo": "skip",
    }


def _band(curve: SmoothCurve, colour: str) -> list[dict[str, Any]]:
    """One closed outline for each stretch where the interval is known."""
    traces = []
    known = np.isfinite(curve.low) & np.isfinite(curve.high)
    ends = np.flatnonzero(np.diff(np.concatenate([[False], known, [False]]).astype(int)))
    for first, last in ends.reshape(-1, 2):
        part = slice(first, last)
        traces.append(
            {
                "type": "scatter",
                "mode": "none",
                "x": typed(np.concatenate([curve.x[part], curve.x[part][::-1]])),
                "y": typed(np.concatenate([curve.low[part], curve.high[part][::-1]])),
                "fill": "toself",
                "fillcolor": _BANDS[colour],
                "hoverinfo": "skip",
            }
        )
    return traces


def _line(curve: SmoothCurve, colour: str, word: str, unit: str) -> dict[str, Any]:
    return {
        "type": "scatter",
        "mode": "lines",
        "x": typed(curve.x),
        "y": typed(curve.mean),
        "line": {"color": colour, "width": 2},
        "hovertemplate": f"{word}: mean %{{y:.3g}} {unit}<extra></extra>",
    }
