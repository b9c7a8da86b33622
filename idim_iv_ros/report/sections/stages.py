"""How far the gap shrinks: nominal model, refit, effect by effect, noise floor; each joint."""

from dataclasses import dataclass
from typing import Any

from idim_iv_ros.diagnosis.result import GapResult, JointGap, Stage
from idim_iv_ros.report.gap_words import small_unit, stage_words, torque_unit
from idim_iv_ros.report.numerals import known, number
from idim_iv_ros.report.section import Report, Section

_COLOURS = {"given": "given", "refit": "refit"}


@dataclass(frozen=True)
class Bar:
    """Part of a bar: class, start and length in percent of the widest."""

    css: str
    start: float
    length: float


@dataclass(frozen=True)
class StageRow:
    """A model at one joint: bars, and gap, interval and tracking error as text."""

    name: str
    bars: tuple[Bar, ...]
    value: str
    interval: str
    tracking: str


@dataclass(frozen=True)
class Waterfall:
    """All models at one joint; `floor` is the line of the noise floor, `origin` its source."""

    joint: str
    unit: str
    small_unit: str
    rows: tuple[StageRow, ...]
    floor: Bar | None
    floor_value: str
    origin: str


def waterfalls(result: GapResult) -> list[Waterfall]:
    """Return the models of each joint."""
    floors = {joint_gap.joint: joint_gap for joint_gap in result.joint_gaps}
    return [_waterfall(result, joint, floors.get(joint)) for joint in result.joints]


def _waterfall(result: GapResult, joint: str, gap: JointGap | None) -> Waterfall:
    floor = None if gap is None else gap.noise_floor
    largest = _largest(result.stages, joint, floor)
    rows, previous = [], None
    for stage in result.stages:
        rows.append(_row(stage, joint, previous, largest))
        value = stage.torque_rms.get(joint)
        previous = value if known(value) else previous
    return Waterfall(
        joint,
        torque_unit(result, joint),
        small_unit(result, joint),
        tuple(rows),
        None if floor is None else bar("full floor", 0.0, floor / largest),
        number(floor),
        gap.floor_origin if gap is not None and floor is not None else "unknown",
    )


def _largest(stages: tuple[Stage, ...], joint: str, floor: float | None) -> float:
    ends = [floor or 0.0]
    for stage in stages:
        value = stage.torque_rms.get(joint)
        high = stage.torque_ci95.get(joint, (0.0, 0.0))[1]
        ends += [bound for bound in (value, high) if bound is not None and known(bound)]
    return 1.04 * max(ends) or 1.0


def _row(stage: Stage, joint: str, previous: float | None, largest: float) -> StageRow:
    value = stage.torque_rms.get(joint)
    interval = stage.torque_ci95.get(joint)
    if interval is not None and not (known(interval[0]) and known(interval[1])):
        interval = None
    bars = []
    if value is not None and known(value):
        colour = _COLOURS.get(stage.name, "effect")
        bars.append(bar(f"full {colour}", 0.0, value / largest))
        if previous is not None and previous > value:
            bars.append(bar(f"gone {colour}", value / largest, previous / largest))
        if interval is not None:
            bars.append(bar("whisker", interval[0] / largest, interval[1] / largest))
    tracking = None if stage.tracking_rms is None else stage.tracking_rms.get(joint)
    return StageRow(
        stage_words(stage.name),
        tuple(bars),
        number(value),
        "–" if interval is None else f"{number(interval[0])} … {number(interval[1])}",
        number(None if tracking is None else 1e3 * tracking),
    )


def bar(css: str, low: float, high: float) -> Bar:
    """Part of a bar from one share of its length to another."""
    return Bar(css, round(100.0 * low, 2), round(100.0 * (high - low), 2))


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
        "joints": waterfalls(report.result),
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
