"""Sections on the drive of each joint: friction over speed, and twist of the gear over load."""

from typing import Any

import numpy as np

from idim_iv_ros.diagnosis.result.document import GapResult, GapSeries
from idim_iv_ros.diagnosis.result.recordings import Transmission, TransmissionSeries
from idim_iv_ros.effects.cause import EffectParameter
from idim_iv_ros.report.figures import (
    BACKWARD,
    BLUE,
    FORWARD,
    GREY,
    INK,
    Figure,
    Mark,
    axis,
    dots,
    layout,
    line,
)
from idim_iv_ros.report.gap_words import drawable, small_unit, torque_unit, unit_in, worth_seeing
from idim_iv_ros.report.numerals import MISSING, THIN, number, with_interval
from idim_iv_ros.report.section import Report, Section
from idim_iv_ros.types import FloatArray

_HEIGHT = 280


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
    """Return the table row of a transmission: its numbers, or bounds of them."""
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
    """Return a figure of the gear's twist over the load, by direction, with the fitted law."""
    torque, small = torque_unit(result, series.joint), small_unit(result, series.joint)
    hover = f"%{{y:.3g}} {small} at %{{x:.3g}} {torque}"
    data: list[dict[str, Any]] = []
    for sign, colour in ((1.0, FORWARD), (-1.0, BACKWARD)):
        rows = series.direction * sign > 0.0
        data.append(dots(series.load[rows], 1e3 * series.twist[rows], colour, 3.5))
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


_FRICTION_HEIGHT = 210
_LEAST_ROWS = 20  # of a direction, for a curve
_BINS = 40  # of a direction, with equally many rows


def _friction(report: Report[GapResult]) -> dict[str, Any] | None:
    drawn = drawable(report.result)
    if not drawn:
        return None
    legend = [Mark("sign diamond", GREY, "measured, less the torque of everything but friction")]
    if drawn[0].given_friction is not None:
        legend.append(Mark("line", INK, "nominal model"))
    legend.append(Mark("line", BLUE, "extended model"))
    first = worth_seeing(report.result)
    plots = [
        (series.joint, _friction_figure(report.result, series, number), series.joint in first)
        for number, series in enumerate(drawn)
    ]
    return {"legend": legend, "plots": sorted(plots, key=lambda plot: not plot[-1])}


def _friction_figure(result: GapResult, series: GapSeries, number: int) -> Figure:
    unit, speed = torque_unit(result, series.joint), unit_in(result, "rad/s", series.joint)
    shown = series.torque - series.extended + series.friction
    data, seen = [dots(series.speed, shown, GREY, 4.0)], shown
    if series.given_friction is not None:
        seen = np.concatenate([shown, series.given_friction])
        data += _curves(series, series.given_friction, INK, f"nominal %{{y:.3g}} {unit}")
    data += _curves(series, series.friction, BLUE, f"extended %{{y:.3g}} {unit}")
    axes = {
        "xaxis": axis(f"Speed, {speed}", nticks=6, zeroline=True, zerolinecolor=GREY),
        "yaxis": axis(
            f"Friction, {unit}", nticks=5, zeroline=True, zerolinecolor=GREY, range=_range(seen)
        ),
    }
    words = f"Friction of {series.joint} over its speed: measured, nominal and fitted"
    return Figure(f"friction-{number}", _FRICTION_HEIGHT, words, data, layout(axes))


def _range(values: FloatArray) -> list[float]:
    low, high = np.percentile(values[np.isfinite(values)], [0.5, 99.5])
    room = 0.12 * max(float(high - low), 1e-12)
    return [float(low) - room, float(high) + room]


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


FRICTION = Section("Friction", "friction", "friction.html.j2", _friction)
