"""Sections on torque over time and what each model leaves of it, and on closed-loop tracking."""

from typing import Any, NamedTuple

import numpy as np

from idim_iv_ros.diagnosis.result.document import GapResult, Stage, TrackingSeries
from idim_iv_ros.identification.result import IdentificationResult
from idim_iv_ros.report import gap_words
from idim_iv_ros.report.figures import (
    BLUE,
    GREY,
    INK,
    ORANGE,
    SHADE,
    Figure,
    TimeCurve,
    outline,
    over_time,
)
from idim_iv_ros.report.numerals import is_interval, is_number, percent, with_unit
from idim_iv_ros.report.section import Report, Result
from idim_iv_ros.report.time_axis import Curves, curves, peaks
from idim_iv_ros.types import FloatArray

_HEIGHT = 320


class _Joint(NamedTuple):
    """Curves of one joint; a model has name, torque (n,), N m (N), and colour."""

    joint: str
    time: FloatArray
    measured: FloatArray
    models: list[tuple[str, FloatArray, str]]
    words: str
    step: float | None


def torque_rows(result: Result) -> list[_Joint]:
    """Return the curves of each joint that has a series."""
    return _model_curves(result) if isinstance(result, GapResult) else _predicted_curves(result)


def torque_marks(rows: list[_Joint]) -> list[tuple[str, str, str]]:
    """Return entries of a legend for the models."""
    models = {name: colour for row in rows for name, _, colour in row.models}
    return [("line", colour, name) for name, colour in models.items()]


def _predicted_curves(result: IdentificationResult) -> list[_Joint]:
    rows = []
    for series, residual in zip(result.series, result.residuals, strict=True):
        size = with_unit(residual.rms, gap_words.torque_unit(result, series.joint), 2)
        words = f"residual {percent(residual.relative_percent)}, rms {size}"
        models = [("predicted", series.predicted, BLUE)]
        rows.append(_Joint(series.joint, series.time, series.measured, models, words, None))
    return rows


def _model_curves(result: GapResult) -> list[_Joint]:
    rows = []
    for series in gap_words.drawable(result):
        models = [] if series.given is None else [("nominal model", series.given, GREY)]
        models.append(("refit", series.refit, ORANGE))
        if gap_words.extended_beyond_refit(series):
            models.append(("extended model", series.extended, BLUE))
        words = gap_words.held_out_words(result, series.joint)
        rows.append(_Joint(series.joint, series.time, series.torque, models, words, series.step))
    return rows


def torque_figure(report: Report[Any], rows: _Joint, index: int) -> Figure:
    """Return a figure: measured and modelled torque above, measured less modelled below."""
    unit, session = gap_words.torque_unit(report.result, rows.joint), report.session
    left = "Gap" if isinstance(report.result, GapResult) else "Residual"
    torques = [values for _, values, _ in rows.models]
    residuals = [rows.measured - values for values in torques]
    thinned = curves(
        rows.time,
        [*torques, *residuals, rows.measured],
        session,
        peaks_of=[rows.measured, residuals[0], residuals[-1]],
        step=rows.step,
    )
    size = f"%{{y:.4g}} {unit}"
    count = len(rows.models)
    upper, lower, measured = (thinned.values[:count], thinned.values[count:-1], thinned.values[-1])
    drawn = []
    for (name, _, colour), model, residual in zip(rows.models, upper, lower, strict=True):
        drawn.append(TimeCurve(model, colour, 2.4, f"{name} {size}"))
        drawn.append(TimeCurve(residual, colour, 1.0, f"measured − {name} {size}", below=True))
    # The measured torque is drawn last: thin, above the wider models.
    drawn.append(TimeCurve(measured, INK, 0.9, f"measured {size}"))
    return over_time(
        f"torque-{index}",
        _HEIGHT,
        f"Measured torque of {rows.joint} and that of the models over time",
        thinned.time,
        drawn,
        (f"{gap_words.torque_word(unit)}, {unit}", f"{left}, {unit}"),
        0.42,
        behind=[*_shade(thinned, "y", [*upper, measured]), *_shade(thinned, "y2", list(lower))],
        **session.marks(),
    )


def _shade(thinned: Curves, y_axis: str, drawn: list[FloatArray]) -> list[dict[str, Any]]:
    """Return all gaps of the recording as one filled trace, as tall as the curves."""
    values = np.concatenate(drawn)
    values = values[np.isfinite(values)]
    if len(thinned.gaps) == 0 or len(values) == 0:
        return []
    low, high = float(values.min()), float(values.max())
    start, end = thinned.gaps[:, 0], thinned.gaps[:, 1]
    apart = np.full(len(start), np.nan)
    x = np.column_stack([start, start, end, end, apart]).ravel()
    y = np.tile([low, high, high, low, np.nan], len(start))
    return [outline(x, y, SHADE, yaxis=y_axis)]


# Part of a bar: class, and ends as shares of the widest.
Bar = tuple[str, float, float]


def waterfall(result: GapResult, joint: str) -> dict[str, Any]:
    """Return the models with their bars at one joint, and the noise floor with its bar."""
    gap = next((gap for gap in result.where.joints if gap.joint == joint), None)
    floor = None if gap is None else gap.noise_floor
    sizes = [stage.torque_rms.get(joint) for stage in result.stages]
    intervals = [stage.torque_ci95.get(joint, (None, None)) for stage in result.stages]
    highest = (high for _, high in intervals)
    largest = 1.04 * max(filter(is_number, (floor or 0.0, *sizes, *highest))) or 1.0
    rows: list[tuple[Stage, list[Bar]]] = []
    previous = 0.0
    for stage, value, interval in zip(result.stages, sizes, intervals, strict=True):
        bars: list[Bar] = []
        if is_number(value):
            colour = stage.name if stage.name in ("given", "refit") else "effect"
            bars.append((f"full {colour}", 0.0, value / largest))
            if previous > value:
                bars.append((f"gone {colour}", value / largest, previous / largest))
            if is_interval(interval):
                bars.append(("whisker", interval[0] / largest, interval[1] / largest))
            previous = value
        rows.append((stage, bars))
    bar = None if floor is None else ("full floor", 0.0, floor / largest)
    return {"gap": gap, "rows": rows, "floor": bar}


_BUCKETS = 220


def tracked(result: GapResult) -> list[TrackingSeries]:
    """Return the first series of each joint whose closed loop was simulated."""
    firsts: dict[str, TrackingSeries] = {}
    for series in result.tracking:
        if len(series.time):
            firsts.setdefault(series.joint, series)
    return list(firsts.values())


def simulated_stage(result: GapResult, place: int) -> str:
    """Return in brackets the name of a simulated model by its place (0 first, -1 last)."""
    simulated = [stage.name for stage in result.stages if stage.tracking_rms is not None]
    return f" ({gap_words.stage_words(simulated[place])})" if simulated else ""


def tracking_figure(result: GapResult, series: TrackingSeries) -> Figure:
    """Return a figure: tracking errors above, simulated less recorded ones below."""
    unit = gap_words.small_unit(result, series.joint)
    motions = (("before", series.before, GREY), ("after", series.after, BLUE))
    simulated = [(name, values, colour) for name, values, colour in motions if values is not None]
    # Both errors have the same reference: their difference is that of the positions.
    gaps = [series.measured - values for _, values, _ in simulated]
    chosen = peaks([series.measured, *gaps], _BUCKETS)
    size = f"%{{y:.3g}} {unit}"
    drawn = []
    for (name, values, colour), gap in zip(simulated, gaps, strict=True):
        drawn.append(TimeCurve(1e3 * values[chosen], colour, 2.4, f"{name} {size}"))
        words = f"{name} − robot {size}"
        drawn.append(TimeCurve(1e3 * gap[chosen], colour, 1.0, words, below=True))
    drawn.append(TimeCurve(1e3 * series.measured[chosen], INK, 0.9, f"robot {size}"))
    return over_time(
        f"tracking-{result.joints.index(series.joint)}",
        _HEIGHT,
        f"Tracking error of {series.joint}, robot and simulations, over time",
        series.time[chosen],
        drawn,
        (f"Error, {unit}", f"Gap, {unit}"),
        0.46,
    )
