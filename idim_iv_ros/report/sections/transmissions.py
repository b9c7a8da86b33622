"""What encoders behind the gears say: stiffness, play and time offset, and twist over load."""

from typing import Any

import numpy as np

from idim_iv_ros.diagnosis.result import (
    EffectParameter,
    GapResult,
    Transmission,
    TransmissionSeries,
)
from idim_iv_ros.report.figures import (
    BACKWARD,
    FORWARD,
    INK,
    Figure,
    Mark,
    axis,
    layout,
    line,
    typed,
)
from idim_iv_ros.report.gap_words import small_unit, torque_unit
from idim_iv_ros.report.numerals import MISSING, THIN, number, with_interval
from idim_iv_ros.report.section import Report, Section

_HEIGHT = 280
_DOTS = 400  # of one direction


def _context(report: Report[GapResult]) -> dict[str, Any] | None:
    result = report.result
    if not result.transmissions:
        return None
    by_joint = {transmission.joint: transmission for transmission in result.transmissions}
    plots = [
        (series.joint, "", twist_figure(result, series, by_joint[series.joint], index))
        for index, series in enumerate(result.twists)
    ]
    return {
        "rows": [_row(result, transmission) for transmission in result.transmissions],
        "legend": [
            Mark("line", FORWARD, "forwards (speed > 0)"),
            Mark("line", BACKWARD, "backwards"),
            Mark("line", INK, "load over stiffness, with play"),
        ],
        "plots": plots,
    }


def _row(result: GapResult, transmission: Transmission) -> dict[str, str]:
    small = small_unit(result, transmission.joint)
    bound = ""
    if transmission.stiffness is None and transmission.stiffness_at_least is not None:
        bound = f"> {number(transmission.stiffness_at_least, 2)}"
    gap = MISSING
    if transmission.backlash is None and transmission.backlash_at_most is not None:
        gap = f"< {number(1e3 * transmission.backlash_at_most, 2)}{THIN}{small}"
    share = MISSING
    if transmission.time_offset is not None:
        share = f"{100.0 * transmission.elastic_share:.0f}{THIN}%"
    return {
        "joint": transmission.joint,
        "stiffness": _number(transmission.stiffness)
        if transmission.stiffness
        else bound or MISSING,
        "damping": _number(transmission.damping),
        "backlash": _number(transmission.backlash, 1e3, small) if transmission.backlash else gap,
        "lost_motion": _number(transmission.lost_motion, 1e3, small),
        "offset": _number(transmission.time_offset, 1e3, "ms"),
        "share": share,
        "remark": transmission.reason,
    }


def _number(parameter: EffectParameter | None, scale: float = 1.0, unit: str = "") -> str:
    if parameter is None:
        return MISSING
    std = None if parameter.std is None else scale * parameter.std
    return with_interval(scale * parameter.value, std, unit or parameter.unit)


def twist_figure(
    result: GapResult, series: TransmissionSeries, transmission: Transmission, index: int = 0
) -> Figure:
    """Return the twist over the load, by direction of motion, with the measured law."""
    torque, small = torque_unit(result, series.joint), small_unit(result, series.joint)
    hover = f"%{{y:.3g}} {small} at %{{x:.3g}} {torque}"
    data: list[dict[str, Any]] = []
    for sign, colour in ((1.0, FORWARD), (-1.0, BACKWARD)):
        chosen = np.flatnonzero(series.direction * sign > 0.0)
        chosen = chosen[:: max(1, -(-len(chosen) // _DOTS))]
        data.append(
            {
                "type": "scatter",
                "mode": "markers",
                "x": typed(series.load[chosen]),
                "y": typed(1e3 * series.twist[chosen]),
                "marker": {"color": colour, "size": 3.5, "opacity": 0.6},
                "hovertemplate": f"{hover}<extra></extra>",
            }
        )
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
    return Figure(f"transmission-{index}", _HEIGHT, words, data, layout(axes))


TRANSMISSIONS = Section(
    "Transmissions",
    "transmissions",
    "transmissions.html.j2",
    _context,
    "stiffness and play that encoders behind the gears show",
)
