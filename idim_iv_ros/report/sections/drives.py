"""Sections on what a joint does over its motion: friction, twist of the gear, and the residual."""

from typing import Any

import numpy as np

from idim_iv_ros.diagnosis.result.document import GapResult, GapSeries
from idim_iv_ros.diagnosis.result.recordings import TransmissionSeries
from idim_iv_ros.report.figures import (
    BACKWARD,
    BACKWARD_BAND,
    BLUE,
    FORWARD,
    FORWARD_BAND,
    GREY,
    INK,
    Figure,
    axis,
    dots,
    line,
    outline,
)
from idim_iv_ros.report.gap_words import (
    extended_beyond_refit,
    small_unit,
    torque_unit,
    unit_in,
)
from idim_iv_ros.report.numerals import round_number
from idim_iv_ros.statistics.curves import SmoothCurve, smooth
from idim_iv_ros.types import FloatArray

_HEIGHT = 280


def twist_figure(result: GapResult, series: TransmissionSeries) -> Figure:
    """Return a figure of the gear's twist over the load, by direction, with the fitted law."""
    transmission = next(gear for gear in result.transmissions if gear.joint == series.joint)
    index = result.joints.index(series.joint)
    torque, small = torque_unit(result, series.joint), small_unit(result, series.joint)
    hover = f"%{{y:.3g}} {small} at %{{x:.3g}} {torque}"
    sides = ((series.direction > 0.0, FORWARD), (series.direction < 0.0, BACKWARD))
    data = [dots(series.load[at], 1e3 * series.twist[at], colour, 3.5) for at, colour in sides]
    ends = np.array([float(series.load.min()), float(series.load.max())])
    load = np.sort(np.append(ends, [-1e-9, 1e-9])) if ends[0] < 0.0 < ends[1] else ends
    law = np.zeros(len(load))
    if transmission.stiffness is not None:
        law = law + load / transmission.stiffness.value
    if transmission.backlash is not None:
        law = law + 0.5 * transmission.backlash.value * np.sign(load)
    if transmission.stiffness is not None or transmission.backlash is not None:
        data.append(line(load, 1e3 * law, INK, 1.6, hover))
    axes = {"xaxis": axis(f"Load, {torque}"), "yaxis": axis(f"Twist, {small}", nticks=6)}
    words = f"Twist of the gear of {series.joint} over its load, by direction of motion"
    return Figure(f"transmission-{index}", _HEIGHT, words, data, axes)


_FRICTION_HEIGHT = 210
_LEAST_ROWS = 20  # of a direction, for a curve
_BINS = 40  # of a direction, with equally many rows


def friction_figure(result: GapResult, series: GapSeries) -> Figure:
    """Return a figure of the friction of a joint over its speed: measured, nominal and fitted."""
    unit, speed = torque_unit(result, series.joint), unit_in(result, "rad/s", series.joint)
    shown = series.torque - series.extended + series.friction
    data, seen = [dots(series.speed, shown, GREY, 4.0)], shown
    if series.given_friction is not None:
        seen = np.concatenate([shown, series.given_friction])
        data += _curves(series, series.given_friction, INK, f"nominal %{{y:.3g}} {unit}")
    data += _curves(series, series.friction, BLUE, f"extended %{{y:.3g}} {unit}")
    low, high = np.percentile(seen[np.isfinite(seen)], [0.5, 99.5])
    room = 0.12 * max(float(high - low), 1e-12)
    ends = [float(low) - room, float(high) + room]
    axes = {
        "xaxis": axis(f"Speed, {speed}", nticks=6, zeroline=True, zerolinecolor=GREY),
        "yaxis": axis(f"Friction, {unit}", nticks=5, zeroline=True, zerolinecolor=GREY, range=ends),
    }
    words = f"Friction of {series.joint} over its speed: measured, nominal and fitted"
    anchor = f"friction-{result.joints.index(series.joint)}"
    return Figure(anchor, _FRICTION_HEIGHT, words, data, axes)


def _curves(
    series: GapSeries, friction: FloatArray, colour: str, hover: str
) -> list[dict[str, Any]]:
    """Return a model's friction averaged in bins of the speed, one line a direction."""
    traces = []
    for sign in (1.0, -1.0):
        rows = np.flatnonzero((sign * series.speed > 0.0) & np.isfinite(friction))
        if len(rows) >= _LEAST_ROWS:
            rows = rows[np.argsort(series.speed[rows])]
            bins = np.array_split(rows, min(_BINS, len(rows) // 5))
            speed = np.array([np.mean(series.speed[part]) for part in bins])
            mean = np.array([np.mean(friction[part]) for part in bins])
            traces.append(line(speed, mean, colour, 2.4, hover))
    return traces


_BANDS = {FORWARD: FORWARD_BAND, BACKWARD: BACKWARD_BAND}
_ROW_HEIGHT = 190
_GAP, _BETWEEN = 0.045, 0.05
_SHORTEST = 1e-5  # rad or m; shorter distances since a reversal are drawn there


def _residuals(result: GapResult, series: GapSeries) -> dict[str, FloatArray]:
    """Return the residual of each model, a row of panels each."""
    models = {"refit": series.refit}
    # A refit hides what only the parameters of the nominal model have wrong.
    parametric = any(cause.kind == "parametric" for cause in result.causes)
    if series.given is not None and (parametric or not result.causes):
        models = {"nominal": series.given, **models}
    if extended_beyond_refit(series):
        models["extended"] = series.extended
    return {name: series.torque - torque for name, torque in models.items()}


def residual_figure(result: GapResult, series: GapSeries) -> Figure:
    """Return a figure of the residual of a joint over what an effect may follow, a row a model."""
    rows = _residuals(result, series)
    unit = torque_unit(result, series.joint)
    panels = _panels(series, unit, unit_in(result, "rad", series.joint))
    data: list[dict[str, Any]] = []
    axes: dict[str, Any] = {}
    bottom = f"y{_suffix(len(rows) - 1)}"
    limits = {True: 0.0, False: 0.0}  # of the nominal model, and of the fitted ones together
    for column, (x, x_axis) in enumerate(panels):
        low = column * (1.0 + _GAP) / len(panels)
        domain = [low, low + (1.0 + _GAP) / len(panels) - _GAP]
        name = _suffix(column)
        axes[f"xaxis{name}"] = {**x_axis, "domain": domain, "anchor": bottom}
        for k, (model, residual) in enumerate(rows.items()):
            traces, largest = _panel(series, x, residual, unit)
            data += [{**trace, "xaxis": f"x{name}", "yaxis": f"y{_suffix(k)}"} for trace in traces]
            limits[model == "nominal"] = max(limits[model == "nominal"], largest)
    height = (1.0 - _BETWEEN * (len(rows) - 1)) / len(rows)
    for k, model in enumerate(rows):
        limit = 1.15 * limits[model == "nominal"] or 1.0
        top = 1.0 - k * (height + _BETWEEN)
        axes[f"yaxis{_suffix(k)}"] = axis(
            f"{model}, {unit}",
            domain=[max(top - height, 0.0), top],
            range=[-limit, limit],
            nticks=5,
            zeroline=True,
            zerolinecolor=GREY,
        )
    over = "speed, position, load and distance since reversal"
    words = f"Residual of {series.joint} over {over}: {', '.join(rows)}"
    anchor = f"residual-{result.joints.index(series.joint)}"
    return Figure(anchor, _ROW_HEIGHT * len(rows) + 44, words, data, axes)


def _suffix(place: int) -> str:
    return "" if place == 0 else str(place + 1)


def _panels(
    series: GapSeries, torque_unit: str, position_unit: str
) -> list[tuple[FloatArray, dict[str, Any]]]:
    since = np.log10(np.maximum(series.since_reversal, _SHORTEST))
    low, high = np.percentile(since, [1.0, 100.0])
    ticks = list(range(int(np.ceil(low)), int(np.floor(high)) + 1))
    distance = axis(
        f"Distance since reversal, {position_unit}",
        tickvals=ticks,
        ticktext=[round_number(10.0**tick) for tick in ticks],
        range=[float(low), float(high) + 0.03],
    )
    return [
        (_root(series.speed), _speed_axis(series.speed, f"{position_unit}/s")),
        (series.position, axis(f"Position, {position_unit}", nticks=6)),
        (series.load, axis(f"Load (rigid bodies), {torque_unit}", nticks=6)),
        (since, distance),
    ]


def _root(values: FloatArray) -> FloatArray:
    return np.asarray(np.sign(values) * np.sqrt(np.abs(values)))


def _speed_axis(speed: FloatArray, unit: str) -> dict[str, Any]:
    """Return an axis stretched near zero, where friction changes fastest."""
    largest = float(np.percentile(np.abs(speed), 99.5))
    # Round speeds at about a third, two thirds and the end of the stretched axis.
    ticks = [float(f"{share * largest:.1g}") for share in (0.1, 0.4, 0.9) if largest > 0.0]
    values = [-tick for tick in reversed(ticks)] + [0.0, *ticks]
    return axis(
        f"Speed, {unit} (stretched near 0)",
        tickvals=_root(np.array(values)).tolist(),
        ticktext=[round_number(value) for value in values],
        tickangle=0,
    )


def _panel(
    series: GapSeries, abscissa: FloatArray, residual: FloatArray, unit: str
) -> tuple[list[dict[str, Any]], float]:
    """Return the traces of both directions in one panel, and their largest absolute value."""
    traces: list[dict[str, Any]] = []
    largest = 0.0
    directions = (("forwards", FORWARD, 1.0), ("backwards", BACKWARD, -1.0))
    for word, colour, sign in directions:
        rows = np.flatnonzero((sign * series.speed > 0.0) & np.isfinite(residual))
        if len(rows) < 2:
            continue
        x, y = abscissa[rows], residual[rows]
        curve = smooth(x, y, series.time[rows])
        traces += [
            dots(x, y, colour),
            *_band(curve, colour),
            line(curve.x, curve.mean, colour, 2.0, f"{word}: mean %{{y:.3g}} {unit}"),
        ]
        drawn = np.abs(np.concatenate([curve.mean, curve.low, curve.high]))
        drawn = drawn[np.isfinite(drawn)]
        mean = np.percentile(drawn, 99.0) if len(drawn) else 0.0
        largest = max(largest, float(mean), float(np.percentile(np.abs(y), 96.0)))
    return traces, largest


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
