"""Measured against modelled torque over time, with what each model leaves."""

from typing import Any

from idim_iv_ros.diagnosis.result import GapResult, GapSeries
from idim_iv_ros.report.figures import (
    BLUE,
    INK,
    ORANGE,
    PALE,
    Figure,
    axis,
    embed,
    figure,
    legend,
    typed,
)
from idim_iv_ros.report.gap_words import drawable, extended_beyond_refit, rms, torque_unit
from idim_iv_ros.report.markup import Html, section, tag
from idim_iv_ros.report.numerals import number
from idim_iv_ros.report.series import interrupted, peaks
from idim_iv_ros.report.session_axis import SessionAxis, axis_of_diagnosis
from idim_iv_ros.report.units import torque_word
from idim_iv_ros.types import FloatArray

_HEIGHT = 320
_BUCKETS = 260
_FEW = 3


def torque_section(result: GapResult) -> Html | None:
    """Return one plot for each joint, or None without series."""
    session = axis_of_diagnosis(result)
    plots = [
        _joint(result, series, index, session) for index, series in enumerate(drawable(result))
    ]
    if not plots:
        return None
    given = any(each.given is not None for each in result.series)
    marks = [("line", PALE, "measured")]
    marks += [("line", INK, "nominal model")] if given else []
    marks += [("line", ORANGE, "refit")]
    if any(extended_beyond_refit(each) for each in drawable(result)):
        marks += [("line", BLUE, "extended model")]
    return section(
        "Measured and modelled torque",
        "torque",
        tag(
            "p",
            "Above: torque, each model at the measured motion. Below: measured minus modelled. "
            f"Drag to zoom, double-click to go back.{session.words}",
            css="explanation",
        ),
        legend(*marks),
        tag("div", plots, css="grid one" if len(plots) <= _FEW else "grid two"),
    )


def _joint(result: GapResult, series: GapSeries, index: int, session: SessionAxis) -> Html:
    unit = torque_unit(result, series.joint)
    models = _models(series)
    sizes = ", ".join(
        f"{name} {number(rms(series.torque - values), 2)} {unit}" for name, values, _ in models
    )
    words = f"Measured torque of {series.joint} and that of the models over time"
    return tag(
        "div",
        tag("h3", series.joint, tag("small", f" gap, rms: {sizes}")),
        embed(_drawing(series, models, unit, session), f"torque-{index}", _HEIGHT, words),
        css="plot",
    )


def _models(series: GapSeries) -> list[tuple[str, FloatArray, str]]:
    models = [("refit", series.refit, ORANGE)]
    if extended_beyond_refit(series):
        models.append(("extended", series.extended, BLUE))
    if series.given is not None:
        models.insert(0, ("given", series.given, INK))
    return models


def _drawing(
    series: GapSeries,
    models: list[tuple[str, FloatArray, str]],
    unit: str,
    session: SessionAxis,
) -> Figure:
    residuals = [series.torque - values for _, values, _ in models]
    chosen = peaks([series.torque, residuals[0], residuals[-1]], _BUCKETS)

    def trace(values: FloatArray, rows: str, colour: str, width: float, name: str) -> Any:
        time, drawn = interrupted(series.time, values, chosen, series.step, session)
        return {
            "type": "scatter",
            "mode": "lines",
            "x": typed(time),
            "y": typed(drawn),
            "yaxis": rows,
            "line": {"color": colour, "width": width},
            "hovertemplate": f"{name} %{{y:.4g}} {unit} at %{{x:.3f}} s<extra></extra>",
        }

    data = [trace(series.torque, "y", PALE, 2.6, "measured")]
    for (name, values, colour), residual in zip(models, residuals, strict=True):
        data.append(trace(values, "y", colour, 1.1, name))
        data.append(trace(residual, "y2", colour, 0.9, f"measured − {name}"))
    axes = {
        "xaxis": axis("Time, s", anchor="y2"),
        "yaxis": axis(f"{torque_word(unit)}, {unit}", domain=[0.46, 1.0], nticks=6),
        "yaxis2": axis(f"Gap, {unit}", domain=[0.0, 0.38], nticks=5),
    }
    return figure(data, axes, hovermode="closest", **session.marks())
