"""Tracking error of the robot, and of its simulation before and after."""

from typing import Any

import numpy as np

from idim_iv_ros.diagnosis.result import GapResult, TrackingSeries
from idim_iv_ros.report.figures import BLUE, INK, PALE, Figure, axis, embed, figure, legend, typed
from idim_iv_ros.report.gap_words import small_unit, stage_words
from idim_iv_ros.report.markup import Html, section, tag
from idim_iv_ros.report.series import peaks
from idim_iv_ros.types import FloatArray

_HEIGHT = 320
_BUCKETS = 220
_FEW = 3


def tracking_section(result: GapResult) -> Html | None:
    """Return one plot for each joint (its first recording), or None without simulations."""
    firsts: dict[str, TrackingSeries] = {}
    for series in result.tracking:
        if len(series.time):
            firsts.setdefault(series.joint, series)
    if not firsts:
        return None
    plots = [_joint(result, series, index) for index, series in enumerate(firsts.values())]
    missing = any(each.before is None or each.after is None for each in firsts.values())
    return section(
        "Tracking error in closed loop",
        "tracking",
        tag(
            "p",
            "Above: reference minus position, of the robot and of its simulation under the same "
            "controller and references. Below: position of the simulation minus that of the "
            "robot, the gap that the tables above give as tracking. It scales with the inverse "
            "of the gains: compare it at these gains only, and judge the model by its torque gap. "
            "The first recording of each joint is drawn.",
            css="explanation",
        ),
        legend(
            ("line", PALE, "robot"),
            ("line", INK, f"simulated, before{_stage(result, 0)}"),
            ("line", BLUE, f"simulated, after{_stage(result, -1)}"),
        ),
        tag("p", "A line is missing where the simulation diverged.") if missing else None,
        tag("div", plots, css="grid one" if len(plots) <= _FEW else "grid two"),
    )


def _stage(result: GapResult, place: int) -> str:
    """Return in brackets which of the simulated models it is."""
    simulated = [stage.name for stage in result.stages if stage.tracking_rms is not None]
    return f" ({stage_words(simulated[place])})" if simulated else ""


def _joint(result: GapResult, series: TrackingSeries, index: int) -> Html:
    words = f"Tracking error of {series.joint}, robot and simulations, over time"
    return tag(
        "div",
        tag("h3", series.joint, tag("small", f" {series.bag}")),
        embed(
            _drawing(series, small_unit(result, series.joint)), f"tracking-{index}", _HEIGHT, words
        ),
        css="plot",
    )


def _drawing(series: TrackingSeries, unit: str) -> Figure:
    curves: list[tuple[str, FloatArray | None, str, float]] = [
        ("robot", series.measured, PALE, 2.6),
        ("before", series.before, INK, 1.1),
        ("after", series.after, BLUE, 1.2),
    ]
    shown = [
        (name, values, colour, width)
        for name, values, colour, width in curves
        if values is not None
    ]
    # Both errors have the same reference: their difference is that of the positions.
    gaps = [
        (f"{name} − robot", series.measured - values, colour, width)
        for name, values, colour, width in shown[1:]
    ]
    chosen = peaks([series.measured, *(gap for _, gap, *_ in gaps)], _BUCKETS)

    def trace(values: FloatArray, rows: str, colour: str, width: float, name: str) -> Any:
        return {
            "type": "scatter",
            "mode": "lines",
            "x": typed(np.asarray(series.time)[chosen]),
            "y": typed(1e3 * np.asarray(values)[chosen]),
            "yaxis": rows,
            "line": {"color": colour, "width": width},
            "hovertemplate": f"{name} %{{y:.3g}} {unit} at %{{x:.3f}} s<extra></extra>",
        }

    data = [trace(values, "y", colour, width, name) for name, values, colour, width in shown]
    data += [trace(values, "y2", colour, width, name) for name, values, colour, width in gaps]
    axes = {
        "xaxis": axis("Time, s", anchor="y2"),
        "yaxis": axis(f"Error, {unit}", domain=[0.46, 1.0], nticks=6),
        "yaxis2": axis(f"Gap, {unit}", domain=[0.0, 0.38], nticks=5),
    }
    return figure(data, axes, hovermode="closest")
