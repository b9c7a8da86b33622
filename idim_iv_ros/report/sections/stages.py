"""Sections on how the gap shrinks model by model, and in which regimes of motion it lies."""

from typing import Any

from idim_iv_ros.diagnosis.result.document import GapResult, Regime, Stage
from idim_iv_ros.report.gap_words import AXES, regime_range, small_unit, stage_words, torque_unit
from idim_iv_ros.report.numerals import is_interval, is_number, number, percent
from idim_iv_ros.report.section import Report, Section

# Part of a bar: class, start and length in percent of the widest.
Bar = dict[str, str | float]


def _waterfall(result: GapResult, joint: str) -> dict[str, Any]:
    """Return bars of all models at one joint, with the line and the origin of the noise floor."""
    gap = next((gap for gap in result.where.joints if gap.joint == joint), None)
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
        ends += filter(is_number, (value, high))
    return 1.04 * max(ends) or 1.0


def _row(stage: Stage, joint: str, previous: float | None, largest: float) -> dict[str, Any]:
    """Return one model at one joint: bars as shares of `largest`, and its numbers as text."""
    value = stage.torque_rms.get(joint)
    interval = stage.torque_ci95.get(joint)
    bars = []
    if is_number(value):
        colour = stage.name if stage.name in ("given", "refit") else "effect"
        bars.append(bar(f"full {colour}", 0.0, value / largest))
        if previous is not None and previous > value:
            bars.append(bar(f"gone {colour}", value / largest, previous / largest))
        if is_interval(interval):
            bars.append(bar("whisker", interval[0] / largest, interval[1] / largest))
    tracking = None if stage.tracking_rms is None else stage.tracking_rms.get(joint)
    return {
        "name": stage_words(stage.name),
        "bars": bars,
        "value": number(value),
        "interval": " … ".join(map(number, interval)) if is_interval(interval) else "–",
        "tracking": number(None if tracking is None else 1e3 * tracking),
    }


def bar(css: str, low: float, high: float) -> Bar:
    """Return the part of a bar from `low` to `high`, shares of its full length."""
    start, length = round(100.0 * low, 2), round(100.0 * (high - low), 2)
    return {"css": css, "start": start, "length": length}


def _remarks(stages: tuple[Stage, ...]) -> list[str]:
    """Return the distinct notes of the stages, each with its models."""
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


def _regimes(report: Report[GapResult]) -> dict[str, Any] | None:
    result = report.result
    if not result.where.regimes:
        return None
    of_joint = sorted(result.where.regimes, key=lambda regime: result.joints.index(regime.joint))
    return {"rows": [_regime_row(result, regime) for regime in of_joint]}


def _regime_row(result: GapResult, regime: Regime) -> tuple[str, ...]:
    """Return joint, axis, range with unit, shares of gap and samples, lift with its interval."""
    bounds = regime_range(regime, result.session)
    if not (regime.axis == "time" and len(result.session) > 1):
        bounds = f"{bounds} {regime.unit}".strip()
    lift = number(regime.lift, 2)
    if is_interval(regime.ci95):
        lift += f" ({number(regime.ci95[0], 2)} to {number(regime.ci95[1], 2)})"
    shares = (percent(100.0 * share) for share in (regime.energy_share, regime.occupancy))
    return (regime.joint, AXES.get(regime.axis, regime.axis), bounds, *shares, lift)


REGIMES = Section(
    "Regimes",
    "where",
    "regimes.html.j2",
    _regimes,
    "at which speeds, positions, loads and times the gap lies",
)
