"""Tracking error of the robot, and of its simulation before and after."""

from typing import Any

import numpy as np

from idim_iv_ros.diagnosis.result import GapResult, TrackingSeries
from idim_iv_ros.report.figures import BLUE, GREY, INK, Figure, Mark, axis, layout, line
from idim_iv_ros.report.gap_words import small_unit, stage_words
from idim_iv_ros.report.section import Report, Section
from idim_iv_ros.report.time_axis import peaks
from idim_iv_ros.types import FloatArray

_HEIGHT = 320
_BUCKETS = 220
_FEW = 3


def _context(report: Report[GapResult]) -> dict[str, Any] | None:
    result = report.result
    firsts: dict[str, TrackingSeries] = {}
    for series in result.tracking:
        if len(series.time):
            firsts.setdefault(series.joint, series)
    if not firsts:
        return None
    plots = [
        (series.joint, series.bag, tracking_figure(series, small_unit(result, series.joint), index))
        for index, series in enumerate(firsts.values())
    ]
    return {
        "missing": any(
            first_stamp.before is None or first_stamp.after is None
            for first_stamp in firsts.values()
        ),
        "legend": [
            Mark("line", INK, "robot"),
            Mark("line", GREY, f"simulated, before{_stage(result, 0)}"),
            Mark("line", BLUE, f"simulated, after{_stage(result, -1)}"),
        ],
        "plots": plots,
        "columns": "one" if len(plots) <= _FEW else "two",
    }


def _stage(result: GapResult, place: int) -> str:
    """Return in brackets which of the simulated models it is."""
    simulated = [stage.name for stage in result.stages if stage.tracking_rms is not None]
    return f" ({stage_words(simulated[place])})" if simulated else ""


def tracking_figure(series: TrackingSeries, unit: str, index: int = 0) -> Figure:
    """Return the errors above, and what of them is not the robot's below."""
    simulated: list[tuple[str, FloatArray, str]] = [
        (name, values, colour)
        for name, values, colour in (
            ("before", series.before, GREY),
            ("after", series.after, BLUE),
        )
        if values is not None
    ]
    # Both errors have the same reference: their difference is that of the positions.
    gaps = [series.measured - values for _, values, _ in simulated]
    chosen = peaks([series.measured, *gaps], _BUCKETS)
    hover = f"%{{y:.3g}} {unit} at %{{x:.3f}} s"

    def drawn(values: FloatArray) -> FloatArray:
        return 1e3 * np.asarray(values)[chosen]

    data = []
    time: object = np.asarray(series.time)[chosen]
    for (name, values, colour), gap in zip(simulated, gaps, strict=True):
        data.append(line(time, drawn(values), colour, 2.4, f"{name} {hover}", yaxis="y"))
        time = {"same": 0}
        data.append(line(time, drawn(gap), colour, 1.0, f"{name} − robot {hover}", yaxis="y2"))
    data.append(line(time, drawn(series.measured), INK, 0.9, f"robot {hover}", yaxis="y"))
    axes = {
        "xaxis": axis("Time, s", anchor="y2"),
        "yaxis": axis(f"Error, {unit}", domain=[0.46, 1.0], nticks=6),
        "yaxis2": axis(f"Gap, {unit}", domain=[0.0, 0.38], nticks=5),
    }
    words = f"Tracking error of {series.joint}, robot and simulations, over time"
    return Figure(f"tracking-{index}", _HEIGHT, words, data, layout(axes))


TRACKING = Section(
    "Tracking",
    "tracking",
    "tracking.html.j2",
    _context,
    "error of the simulated closed loop beside the recorded one",
)
