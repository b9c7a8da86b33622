"""Measured against predicted torque of each joint, with the residual beneath."""

from typing import Any

import numpy as np

from idim_iv_ros.identification.result import IdentificationResult
from idim_iv_ros.report.figures import (
    BLUE,
    GREY,
    ORANGE,
    SHADE,
    Figure,
    axis,
    embed,
    figure,
    legend,
    typed,
)
from idim_iv_ros.report.markup import Html, section, tag
from idim_iv_ros.report.numerals import percent, with_unit
from idim_iv_ros.report.series import PlotSeries, thin
from idim_iv_ros.report.session_axis import SessionAxis, axis_of_identification
from idim_iv_ros.report.units import torque_unit, torque_word

_HEIGHT = 300
_FEW = 3


def torque_section(result: IdentificationResult) -> Html:
    """Return one plot for each joint."""
    plots = []
    session = axis_of_identification(result)
    for index, series in enumerate(result.series):
        unit = torque_unit(result, index)
        residual = result.residuals[index]
        size = f"{percent(residual.relative_percent)}, rms {with_unit(residual.rms, unit, 2)}"
        drawing = _drawing(thin(series, session), unit, session)
        words = f"Measured and predicted torque of {series.joint} over time"
        plots.append(
            tag(
                "div",
                tag("h3", series.joint, tag("small", f" residual {size}")),
                embed(drawing, f"torque-{index}", _HEIGHT, words),
                css="plot",
            )
        )
    return section(
        "Measured and predicted torque",
        "torque",
        tag(
            "p",
            "The predicted torque is the observation matrix of the measured motion times the "
            "estimated parameters; the residual is measured minus predicted. Where the plot is "
            "shaded the samples do not count (reversals, edges, not measured). Drag to zoom, "
            f"double-click to go back.{session.words}",
            css="explanation",
        ),
        legend(
            ("line", GREY, "measured"),
            ("line", BLUE, "predicted"),
            ("line", ORANGE, "residual"),
            ("band", SHADE, "samples that do not count"),
        ),
        tag("div", plots, css="grid one" if len(plots) <= _FEW else "grid two"),
    )


def _drawing(series: PlotSeries, unit: str, session: SessionAxis) -> Figure:
    hover = "%{y:.4g} " + unit + " at %{x:.3f} s"
    data = [
        *_shaded(series, "y", [series.measured, series.predicted]),
        *_shaded(series, "y2", [series.residual]),
        _line(series, series.measured, "y", GREY, 2.4, f"measured {hover}"),
        _line(series, series.predicted, "y", BLUE, 1.3, f"predicted {hover}"),
        _line(series, series.residual, "y2", ORANGE, 1.0, f"residual {hover}"),
    ]
    axes = {
        "xaxis": axis("Time, s", anchor="y2"),
        "yaxis": axis(f"{torque_word(unit)}, {unit}", domain=[0.36, 1.0], nticks=6),
        "yaxis2": axis(f"Residual, {unit}", domain=[0.0, 0.29], nticks=4),
    }
    return figure(data, axes, hovermode="closest", **session.marks())


def _line(
    series: PlotSeries, values: Any, y_axis: str, colour: str, width: float, hover: str
) -> dict[str, Any]:
    return {
        "type": "scatter",
        "mode": "lines",
        "x": typed(series.time),
        "y": typed(values),
        "yaxis": y_axis,
        "line": {"color": colour, "width": width},
        "hovertemplate": f"{hover}<extra></extra>",
    }


def _shaded(series: PlotSeries, y_axis: str, curves: list[Any]) -> list[dict[str, Any]]:
    """Return all gaps as one filled trace, as tall as the curves."""
    values = np.concatenate(curves)
    values = values[np.isfinite(values)]
    if len(series.gaps) == 0 or len(values) == 0:
        return []
    low, high = float(values.min()), float(values.max())
    start, end = series.gaps[:, 0], series.gaps[:, 1]
    apart = np.full(len(start), np.nan)
    x = np.column_stack([start, start, end, end, apart]).ravel()
    y = np.tile([low, high, high, low, np.nan], len(start))
    return [
        {
            "type": "scatter",
            "mode": "none",
            "x": typed(x),
            "y": typed(y),
            "yaxis": y_axis,
            "fill": "toself",
            "fillcolor": SHADE,
            "hoverinfo": "skip",
        }
    ]
