"""Sections on how the gap shrinks model by model, and in which regimes of motion it lies."""

from typing import Any

from idim_iv_ros.diagnosis.result.document import GapResult, Stage
from idim_iv_ros.report.numerals import is_interval, is_number
from idim_iv_ros.report.section import Report, Section

# Part of a bar: class, and ends as shares of the widest.
Bar = tuple[str, float, float]


def _waterfall(result: GapResult, joint: str) -> dict[str, Any]:
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
    return {"joint": joint, "gap": gap, "rows": rows, "floor": bar}


def _context(report: Report[GapResult]) -> dict[str, Any] | None:
    if not report.result.stages:
        return None
    result = report.result
    return {"joints": [_waterfall(result, joint) for joint in result.joints]}


STAGES = Section(
    "Shrinkage",
    "stages",
    "stages.html.j2",
    _context,
    "what each model leaves of the torque, joint by joint, on data not used to fit it",
)


REGIMES: Section[GapResult] = Section(
    "Regimes",
    "where",
    "regimes.html.j2",
    lambda report: {} if report.result.where.regimes else None,
    "at which speeds, positions, loads and times the gap lies",
)
