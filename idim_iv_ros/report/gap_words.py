"""Names and units of a diagnosis in the words of its report."""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from idim_iv_ros.diagnosis.result import GapResult, GapSeries, NotTestable, Regime
from idim_iv_ros.recording import SessionPart, in_recordings
from idim_iv_ros.report.numerals import round_number

VERDICTS = {
    "none": ("good", "✓", "no cause found"),
    "parametric": ("fair", "≈", "parametric: wrong numbers in the nominal model"),
    "structural": ("bad", "≠", "structural: physics is missing in the model"),
    "both": ("bad", "≠", "parametric and structural"),
    "unknown": ("open", "?", "unknown: not in the catalogue, or it cannot be told"),
}
AXES = {
    "speed": "Speed",
    "direction": "Direction",
    "position": "Position",
    "load": "Load",
    "time": "Time",
    "reversal": "Distance since reversal",
    "frequency": "Frequency",
}
_STAGES = {"given": "nominal model", "refit": "refit"}


def effect_words(effect: str) -> str:
    """Return the name of an effect without underscores."""
    return effect.replace("_", " ")


def effect_at(effect: str, joint: str | None, other: str | None = None) -> str:
    """Return an effect with its place."""
    place = " and ".join(each for each in (joint, other) if each)
    return f"{effect_words(effect)} at {place}" if place else effect_words(effect)


def stage_words(stage: str) -> str:
    """Return the name of a stage: ``+stribeck[joint_1]`` as “+ stribeck at joint_1”."""
    effect = re.fullmatch(r"\+([^\[]+)(?:\[(.*)\])?", stage)
    if effect is None:
        return _STAGES.get(stage, stage)
    return f"+ {effect_at(effect[1], effect[2])}"


def prismatic(result: GapResult, joint: str) -> bool:
    """Whether a joint is prismatic."""
    return dict(zip(result.joints, result.joint_types, strict=True)).get(joint) == "prismatic"


def torque_unit(result: GapResult, joint: str | None) -> str:
    """Return the unit of the torque of a joint, or of all where it is None."""
    signals = result.configuration.get("signals")
    unit = signals.get("effort_unit") if isinstance(signals, Mapping) else None
    if unit in ("A", "V"):
        return str(unit)
    joints = result.joints if joint is None else (joint,)
    kinds = {"N" if prismatic(result, each) else "N m" for each in joints}
    return " or ".join(sorted(kinds, reverse=True))


def position_unit(result: GapResult, joint: str) -> str:
    """Return the unit of a position: rad or m."""
    return "m" if prismatic(result, joint) else "rad"


def small_unit(result: GapResult, joint: str | None) -> str:
    """Return the unit of a tracking error, a thousandth of that of the position."""
    joints = result.joints if joint is None else (joint,)
    kinds = {"mm" if prismatic(result, each) else "mrad" for each in joints}
    return " or ".join(sorted(kinds, reverse=True))


def regime_range(regime: Regime, session: Sequence[SessionPart] = ()) -> str:
    """Return the bounds of a regime without their unit; a time is that of one of the recordings."""
    low, high = regime.low, regime.high
    if regime.axis == "direction":
        return "backwards" if low + high < 0.0 else "forwards"
    if regime.axis == "time" and len(session) > 1:
        return in_recordings(session, low, high)
    if not math.isfinite(high):
        return f"> {round_number(low)}" if math.isfinite(low) else "all"
    if not math.isfinite(low):
        return f"< {round_number(high)}"
    return f"{round_number(low)} … {round_number(high)}"


def duration(result: GapResult) -> float:
    """Return the length of all recordings together, s; with the pauses where it is not known."""
    if result.recorded is not None:
        return result.recorded
    return max((float(each.time[-1]) for each in result.series if len(each.time)), default=0.0)


def extended_beyond_refit(series: GapSeries) -> bool:
    """Whether the extended model differs from the refit at a joint."""
    return not np.allclose(series.extended, series.refit, rtol=1e-6, atol=1e-9)


def drawable(result: GapResult) -> list[GapSeries]:
    """Return the series that have enough rows for a figure."""
    return [series for series in result.series if len(series.time) > 1]


def rms(values: NDArray[np.float64]) -> float:
    """Return the root mean square of what is finite; NaN where nothing is."""
    finite = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(finite**2))) if len(finite) else float("nan")


@dataclass(frozen=True)
class Untestable:
    """An effect that cannot be tested for the same reason at some joints, named in `joints`."""

    effect: str
    joints: str
    reason: str
    excitation_needed: str
    smallest: str


def untestable(result: GapResult) -> list[Untestable]:
    """Return the effects that are not testable, joints with the same reason together."""
    groups: dict[tuple[str, str, str], list[NotTestable]] = {}
    for each in result.not_testable:
        key = (each.effect, each.reason, each.excitation_needed)
        groups.setdefault(key, []).append(each)
    return [
        Untestable(effect, _joints(group), reason, needed, _smallest(group))
        for (effect, reason, needed), group in groups.items()
    ]


def _joints(group: list[NotTestable]) -> str:
    return ", ".join(each.joint for each in group if each.joint)


def _smallest(group: list[NotTestable]) -> str:
    sizes = dict.fromkeys(each.smallest for each in group)
    if len(sizes) == 1:
        return group[0].smallest
    return ", ".join(f"{each.joint}: {each.smallest or 'at no size'}" for each in group)
