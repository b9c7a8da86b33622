"""How far the gap shrinks, model by model, and in which regime of the motion it lies."""

import math
from collections.abc import Sequence
from typing import Any

from idim_iv_ros.diagnosis.result import GapResult, Regime, Stage
from idim_iv_ros.report.gap_words import AXES, regime_range, small_unit, stage_words, torque_unit
from idim_iv_ros.report.numerals import is_number, number, percent
from idim_iv_ros.report.section import Report, Section

_COLOURS = {"given": "given", "refit": "refit"}


# Part of a bar: class, start and length in percent of the widest.
Bar = dict[str, str | float]


def _waterfall(result: GapResult, joint: str) -> dict[str, Any]:
    """All models at one joint; `floor` is the line of the noise floor, `origin` its source."""
    gap = next((gap for gap in result.joint_gaps if gap.joint == joint), None)
    floor = None if gap is None else gap.noise_floor
    largest = _largest(result.stages, joint, floor)
    rows, previous = [], None
    for stage in result.stages:
        rows.append(_row(stage, joint, previous, largest))
        value = stage.torque_rms.get(joint)
        previous = value if is_number(value) else previous
    return {
        "joint": joint,
        "unit": torque_unit(result, joint),
        "small_unit": small_unit(result, joint),
        "rows": rows,
        "floor": None if floor is None else bar("full floor", 0.0, floor / largest),
        "floor_value": number(floor),
        "origin": gap.floor_origin if gap is not None and floor is not None else "unknown",
    }


def _largest(stages: tuple[Stage, ...], joint: str, floor: float | None) -> float:
    ends = [floor or 0.0]
    for stage in stages:
        value = stage.torque_rms.get(joint)
        high = stage.torque_ci95.get(joint, (0.0, 0.0))[1]
        ends += [bound for bound in (value, high) if bound is not None and is_number(bound)]
    return 1.04 * max(ends) or 1.0


def _row(stage: Stage, joint: str, previous: float | None, largest: float) -> dict[str, Any]:
    """A model at one joint: bars, and gap, interval and tracking error as text."""
    value = stage.torque_rms.get(joint)
    interval = stage.torque_ci95.get(joint)
    if interval is not None and not (is_number(interval[0]) and is_number(interval[1])):
        interval = None
    bars = []
    if value is not None and is_number(value):
        colour = _COLOURS.get(stage.name, "effect")
        bars.append(bar(f"full {colour}", 0.0, value / largest))
        if previous is not None and previous > value:
            bars.append(bar(f"gone {colour}", value / largest, previous / largest))
        if interval is not None:
            bars.append(bar("whisker", interval[0] / largest, interval[1] / largest))
    tracking = None if stage.tracking_rms is None else stage.tracking_rms.get(joint)
    return {
        "name": stage_words(stage.name),
        "bars": bars,
        "value": number(value),
        "interval": "–" if interval is None else " … ".join(map(number, interval)),
        "tracking": number(None if tracking is None else 1e3 * tracking),
    }


def bar(css: str, low: float, high: float) -> Bar:
    """Part of a bar from one share of its length to another."""
    start, length = round(100.0 * low, 2), round(100.0 * (high - low), 2)
    return {"css": css, "start": start, "length": length}


def _remarks(stages: tuple[Stage, ...]) -> list[str]:
    """Notes of the stages, each once, with the models that it is about."""
    about: dict[str, list[str]] = {}
    for stage in stages:
        if stage.note:
            about.setdefault(stage.note, []).append(stage_words(stage.name))
    return [
        f"{'all models' if len(names) == len(stages) else ', '.join(names)}: {note}"
        for note, names in about.items()
    ]


def _context(report: Report[GapResult]) -> dict[str, Any] | None:
    stages = report.result.stages
    if not stages:
        return None
    return {
        "joints": [_waterfall(report.result, joint) for joint in report.result.joints],
        "tracked": any(stage.tracking_rms for stage in stages),
        "remarks": _remarks(stages),
    }


STAGES = Section(
    "Shrinkage",
    "stages",
    "stages.html.j2",
    _context,
    "what each model leaves of the torque, joint by joint, on data not used to fit it",
)


_STRONGEST = 3.0  # of log2 of the lift; stronger ones have the same colour


def _regimes(report: Report[GapResult]) -> dict[str, Any] | None:
    result = report.result
    if not result.regimes:
        return None
    axes = list(dict.fromkeys([*AXES, *(regime.axis for regime in result.regimes)]))
    maps = [_map(result, axis) for axis in axes]
    return {"maps": [drawing for drawing in maps if drawing is not None]}


def _map(result: GapResult, axis: str) -> dict[str, Any] | None:
    of_axis = sorted(
        (regime for regime in result.regimes if regime.axis == axis), key=lambda x: x.low
    )
    by_joint = {
        joint: regimes
        for joint in result.joints
        if (regimes := [regime for regime in of_axis if regime.joint == joint])
    }
    if not by_joint:
        return None
    bounds = sorted({(cell.low, cell.high) for row in by_joint.values() for cell in row})
    longest = max(by_joint.values(), key=len)
    units = {joint: regimes[0].unit for joint, regimes in by_joint.items()}
    one = next(iter(units.values())) if len(set(units.values())) == 1 else None
    same = len(bounds) == len(longest) and one is not None
    rows = []
    for joint, regimes in by_joint.items():
        placed: list[Regime | None] = list(_placed(regimes, bounds) if same else regimes)
        placed += [None] * (len(longest) - len(placed))
        name = joint if one is not None else f"{joint}, {units[joint]}"
        rows.append((name, [_cell(result, regime, same) for regime in placed]))
    title = AXES.get(axis, axis)
    return {
        "title": f"{title}, {one}" if one else title,
        "heads": [regime_range(regime, result.session) for regime in longest] if same else [],
        "rows": rows,
    }


def _placed(
    regimes: Sequence[Regime], bounds: Sequence[tuple[float, float]]
) -> list[Regime | None]:
    """Regimes at the columns of their bounds; None where a joint has no samples."""
    by_bounds = {(regime.low, regime.high): regime for regime in regimes}
    return [by_bounds.get(bound) for bound in bounds]


def _cell(result: GapResult, regime: Regime | None, same: bool) -> dict[str, Any] | None:
    """Share, range where the head does not say it, CSS class and strength, words."""
    if regime is None:
        return None
    strength = 0.0
    if is_number(regime.lift):
        strength = math.log2(max(regime.lift, 2.0**-_STRONGEST))
    return {
        "share": percent(100.0 * regime.energy_share),
        "range": "" if same else regime_range(regime, result.session),
        "css": "denser" if strength > 0.0 else "thinner",
        "strength": round(75.0 * min(abs(strength) / _STRONGEST, 1.0)),
        "words": _words(result, regime),
    }


def _words(result: GapResult, regime: Regime) -> str:
    interval = ""
    if regime.ci95 is not None and is_number(regime.ci95[0]) and is_number(regime.ci95[1]):
        interval = f" ({number(regime.ci95[0], 2)} to {number(regime.ci95[1], 2)})"
    bounds = regime_range(regime, result.session)
    if not (regime.axis == "time" and len(result.session) > 1):
        bounds = f"{bounds} {regime.unit}".strip()
    return (
        f"{regime.joint}, {bounds}: {percent(100.0 * regime.energy_share)} of the gap in "
        f"{percent(100.0 * regime.occupancy)} of the samples, lift "
        f"{number(regime.lift, 2)}{interval}"
    )


REGIMES = Section(
    "Regimes",
    "where",
    "regimes.html.j2",
    _regimes,
    "at which speeds, positions, loads and times the gap lies",
)
