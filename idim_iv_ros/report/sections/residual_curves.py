"""Residual of a diagnosis over speed, position, load and distance since a reversal."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from idim_iv_ros.diagnosis.result.document import GapResult, GapSeries
from idim_iv_ros.report.figures import (
    BACKWARD,
    BACKWARD_BAND,
    FORWARD,
    FORWARD_BAND,
    GREY,
    Figure,
    Mark,
    axis,
    dots,
    layout,
    line,
    outline,
)
from idim_iv_ros.report.gap_words import (
    drawable,
    extended_beyond_refit,
    held_out_words,
    torque_unit,
    unit_in,
    worth_seeing,
)
from idim_iv_ros.report.numerals import round_number
from idim_iv_ros.report.section import Report, Section
from idim_iv_ros.statistics.curves import SmoothCurve, smooth
from idim_iv_ros.types import FloatArray

_BANDS = {FORWARD: FORWARD_BAND, BACKWARD: BACKWARD_BAND}
_ROW = 190
_GAP, _BETWEEN = 0.045, 0.05
_SHORTEST = 1e-5  # rad or m; shorter distances since a reversal are drawn there


@dataclass(frozen=True)
class Row:
    """One row of panels: the residual of one model.

    Rows with the same `scale` have the same range of the ordinate.
    """

    title: str
    residual: FloatArray
    scale: str


def _context(report: Report[GapResult]) -> dict[str, Any] | None:
    result = report.result
    drawn = drawable(result)
    if not drawn:
        return None
    opened = worth_seeing(result)
    return {
        "legend": [
            Mark("line", FORWARD, "forwards (speed > 0)"),
            Mark("line", BACKWARD, "backwards"),
        ],
        "plots": [
            (
                series.joint,
                held_out_words(result, series.joint),
                _figure(result, series, index),
                series.joint in opened,
            )
            for index, series in enumerate(drawn)
        ],
    }


def _rows(result: GapResult, series: GapSeries) -> list[Row]:
    rows = []
    # A refit hides what only the parameters of the nominal model have wrong.
    parametric = any(cause.kind == "parametric" for cause in result.causes)
    if series.given is not None and (parametric or not result.causes):
        rows.append(Row("nominal", series.torque - series.given, "nominal"))
    rows.append(Row("refit", series.torque - series.refit, "refit"))
    if extended_beyond_refit(series):
        rows.append(Row("extended", series.torque - series.extended, "refit"))
    return rows


def _figure(result: GapResult, series: GapSeries, index: int) -> Figure:
    rows = _rows(result, series)
    unit = torque_unit(result, series.joint)
    panels = _panels(series, unit, unit_in(result, "rad", series.joint))
    data: list[dict[str, Any]] = []
    axes: dict[str, Any] = {}
    limits = {row.scale: 0.0 for row in rows}
    for column, (x, x_axis) in enumerate(panels):
        low = column * (1.0 + _GAP) / len(panels)
        domain = [low, low + (1.0 + _GAP) / len(panels) - _GAP]
        name = _suffix(column)
        axes[f"xaxis{name}"] = {
            **x_axis,
            "domain": domain,
            "anchor": f"y{_suffix(len(rows) - 1)}",
        }
        for k, row in enumerate(rows):
            traces, largest = _panel(series, x, row, unit)
            data += [{**trace, "xaxis": f"x{name}", "yaxis": f"y{_suffix(k)}"} for trace in traces]
            limits[row.scale] = max(limits[row.scale], largest)
    height = (1.0 - _BETWEEN * (len(rows) - 1)) / len(rows)
    for k, row in enumerate(rows):
        limit = 1.15 * limits[row.scale] or 1.0
        top = 1.0 - k * (height + _BETWEEN)
        axes[f"yaxis{_suffix(k)}"] = axis(
            f"{row.title}, {unit}",
            domain=[max(top - height, 0.0), top],
            range=[-limit, limit],
            nticks=5,
            zeroline=True,
            zerolinecolor=GREY,
        )
    words = (
        f"Residual of {series.joint} over speed, position, load and distance since reversal: "
        + ", ".join(row.title for row in rows)
    )
    return Figure(f"residual-{index}", _ROW * len(rows) + 44, words, data, layout(axes))


def _suffix(place: int) -> str:
    """Return the suffix of plotly's name for the axis with that number from 0."""
    return "" if place == 0 else str(place + 1)


def _panels(
    series: GapSeries, torque_unit: str, position_unit: str
) -> list[tuple[FloatArray, dict[str, Any]]]:
    """Return the columns of panels: abscissa as drawn (stretched), and its axis."""
    since = np.log10(np.maximum(series.since_reversal, _SHORTEST))
    return [
        (_root(series.speed), _speed_axis(series.speed, f"{position_unit}/s")),
        (series.position, axis(f"Position, {position_unit}", nticks=6)),
        (series.load, axis(f"Load (rigid bodies), {torque_unit}", nticks=6)),
        (since, _distance_axis(since, position_unit)),
    ]


def _root(values: FloatArray) -> FloatArray:
    return np.asarray(np.sign(values) * np.sqrt(np.abs(values)))


def _speed_axis(speed: FloatArray, unit: str) -> dict[str, Any]:
    """Return an axis stretched near zero, where friction changes fastest."""
    largest = float(np.percentile(np.abs(speed), 99.5)) if len(speed) else 1.0
    ticks = _round_speeds(largest)
    values = [-tick for tick in reversed(ticks)] + [0.0, *ticks]
    return axis(
        f"Speed, {unit} (stretched near 0)",
        tickvals=[float(root) for root in _root(np.array(values))],
        ticktext=[round_number(value) for value in values],
        tickangle=0,
    )


def _round_speeds(largest: float) -> list[float]:
    """Return round speeds up to the largest, far enough apart on the stretched axis."""
    if largest <= 0.0:
        return []
    chosen: list[float] = []
    exponent = int(np.floor(np.log10(largest)))
    for power in range(exponent, exponent - 4, -1):
        for factor in (5.0, 2.0, 1.0):
            value = factor * 10.0**power
            last = np.sqrt(chosen[0]) if chosen else np.sqrt(largest) * 1.3
            room = 0.3 * np.sqrt(largest)
            if value <= largest and last - np.sqrt(value) >= room and np.sqrt(value) >= room:
                chosen.insert(0, value)
    return chosen


def _distance_axis(since: FloatArray, unit: str) -> dict[str, Any]:
    low, high = (-3.0, 0.0) if len(since) == 0 else np.percentile(since, [1.0, 100.0])
    ticks = list(range(int(np.ceil(low)), int(np.floor(high)) + 1))
    return axis(
        f"Distance since reversal, {unit}",
        tickvals=ticks,
        ticktext=[round_number(10.0**tick) for tick in ticks],
        range=[float(low), float(high) + 0.03],
    )


def _panel(
    series: GapSeries, abscissa: FloatArray, row: Row, unit: str
) -> tuple[list[dict[str, Any]], float]:
    """Return the traces of both directions in one panel, and their largest absolute value."""
    traces: list[dict[str, Any]] = []
    largest = 0.0
    directions = (("forwards", FORWARD, 1.0), ("backwards", BACKWARD, -1.0))
    for word, colour, sign in directions:
        rows = np.flatnonzero((sign * series.speed > 0.0) & np.isfinite(row.residual))
        if len(rows) < 2:
            continue
        x, y = abscissa[rows], row.residual[rows]
        curve = smooth(x, y, series.time[rows])
        traces += [
            dots(x, y, colour),
            *_band(curve, colour),
            line(curve.x, curve.mean, colour, 2.0, f"{word}: mean %{{y:.3g}} {unit}"),
        ]
        largest = max(largest, _largest(curve), float(np.percentile(np.abs(y), 96.0)))
    return traces, largest


def _largest(curve: SmoothCurve) -> float:
    values = np.abs(np.concatenate([curve.mean, curve.low, curve.high]))
    values = values[np.isfinite(values)]
    return float(np.percentile(values, 99.0)) if len(values) else 0.0


def _band(curve: SmoothCurve, colour: str) -> list[dict[str, Any]]:
    """Return one filled outline for each stretch where the interval is finite."""
    finite = np.isfinite(curve.low) & np.isfinite(curve.high)
    ends = np.flatnonzero(np.diff(np.concatenate([[False], finite, [False]]).astype(int)))
    return [
        outline(
            np.concatenate([curve.x[first:last], curve.x[first:last][::-1]]),
            np.concatenate([curve.low[first:last], curve.high[first:last][::-1]]),
            _BANDS[colour],
        )
        for first, last in ends.reshape(-1, 2)
    ]


RESIDUAL_CURVES = Section(
    "Residual",
    "residuals",
    "residual_curves.html.j2",
    _context,
    "what is left over speed, position, load and distance since a reversal",
)
