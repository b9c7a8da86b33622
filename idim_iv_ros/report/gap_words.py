"""Names, units and numbers of a diagnosis as text for its report."""

import math
import re
from collections.abc import Mapping, Sequence

import numpy as np

from idim_iv_ros.diagnosis.result.causes import Cause, Hint, ParameterError
from idim_iv_ros.diagnosis.result.document import GapResult, GapSeries, NotTestable, Regime
from idim_iv_ros.diagnosis.result.recordings import ContrastResult
from idim_iv_ros.effects.cause import surest
from idim_iv_ros.effects.registry import parameter_words
from idim_iv_ros.identification.result import IdentificationResult
from idim_iv_ros.model.parameters import unit_at
from idim_iv_ros.recording.recording import SessionPart, in_recordings
from idim_iv_ros.report.numerals import (
    MISSING,
    is_interval,
    is_number,
    number,
    percent,
    plural,
    round_number,
    sentence,
    with_interval,
)

Result = IdentificationResult | GapResult

_VERDICTS = {
    "none": ("good", "✓", "no cause found"),
    "parametric": ("fair", "≈", "parametric: parameter errors of the nominal model"),
    "structural": ("bad", "≠", "structural: effects that the model lacks"),
    "both": ("bad", "≠", "parametric and structural"),
    "unknown": ("open", "?", "unknown: something is there that no certain cause explains"),
}
_LEAST_SHARE = 0.01  # of the torque: a smaller parameter error is not mentioned first
_STAGES = {"given": "nominal model", "refit": "refit"}


def verdict_of(result: GapResult) -> tuple[str, str, str]:
    """Return the verdict of a diagnosis as a badge: CSS class, sign, words."""
    if result.verdict == "none" and not all(recording.agrees for recording in result.recordings):
        return "fair", "≈", "recordings differ; those that agree have no cause"
    return _VERDICTS[result.verdict]


def contrast_badge(contrast: ContrastResult) -> tuple[str, str, str]:
    """Return CSS class, sign and words of the comparison's answer."""
    if contrast.differs is None:
        return "open", "?", "not all joints could be compared"
    if not contrast.differs:
        return "good", "✓", "no difference"
    if contrast.causes:
        return "fair", "≠", "the sets differ"
    return "open", "?", "the sets differ, and nothing in the catalogue explains it"


def effect_words(effect: str) -> str:
    """Return the name of an effect without underscores."""
    return effect.replace("_", " ")


def effect_at(effect: str, joint: str | None, other: str | None = None) -> str:
    """Return an effect with its joints: “backlash at joint_2”."""
    place = " and ".join(name for name in (joint, other) if name)
    return f"{effect_words(effect)} at {place}" if place else effect_words(effect)


def hint_words(hint: Hint) -> str:
    """Return a hint with its joint, and its probability if it has one."""
    words = effect_at(hint.effect, hint.joint, hint.other_joint)
    if hint.probability is None:
        return words
    return f"{words} ({percent(100.0 * hint.probability)} probable)"


def stage_words(stage: str) -> str:
    """Return the name of a stage: ``+stribeck[joint_1]`` as “+ stribeck at joint_1”."""
    effect = re.fullmatch(r"\+([^\[]+)(?:\[(.*)\])?", stage)
    if effect is None:
        return _STAGES.get(stage, stage)
    return f"+ {effect_at(effect[1], effect[2])}"


def unit_in(result: Result, unit: str, joint: str | None) -> str:
    """Return the unit at a joint for a unit of revolute joints with torques in N m.

    Where `joint` is None, the units of all joints: ``N m or N``.
    """
    signals = result.configuration.get("signals")
    given = signals.get("effort_unit") if isinstance(signals, Mapping) else None
    effort = given if isinstance(given, str) else "N m"
    types = dict(zip(result.joints, result.joint_types, strict=True))
    chosen = types.values() if joint is None else [types.get(joint, "revolute")]
    units = {unit_at(unit, joint_name, effort) for joint_name in chosen}
    return " or ".join(sorted(units, key=lambda words: (-len(words), words)))


def torque_unit(result: Result, joint: str | None) -> str:
    """Return the unit of the torque of a joint, or of all joints where it is None."""
    return unit_in(result, "N m", joint)


def small_unit(result: Result, joint: str | None) -> str:
    """Return the unit of a tracking error: mrad, or mm for a prismatic joint."""
    return unit_in(result, "mrad", joint)


def torque_word(unit: str) -> str:
    """Return the name of the quantity with that unit: “Torque” for N m."""
    words = {"N m": "Torque", "N": "Force", "A": "Motor current", "V": "Motor voltage"}
    return words.get(unit, "Effort")


def regime_range(regime: Regime, session: Sequence[SessionPart]) -> str:
    """Return the bounds of a regime with their unit; a time as that in one of the recordings."""
    low, high = regime.low, regime.high
    if regime.axis == "direction":
        return "backwards" if low + high < 0.0 else "forwards"
    if regime.axis == "time" and len(session) > 1:
        return in_recordings(session, low, high)
    bounds = f"{round_number(low)} … {round_number(high)}"
    if not math.isfinite(low):
        bounds = f"< {round_number(high)}"
    if not math.isfinite(high):
        bounds = f"> {round_number(low)}" if math.isfinite(low) else "all"
    return f"{bounds} {regime.unit}".strip()


def duration(result: GapResult) -> float:
    """Return the total length of the recordings, s; if unknown, with the pauses between them."""
    if result.recorded is not None:
        return result.recorded
    ends = (float(series.time[-1]) for series in result.series if len(series.time))
    return max(ends, default=0.0)


def extended_beyond_refit(series: GapSeries) -> bool:
    """Return whether the extended model differs from the refit at a joint."""
    return not np.allclose(series.extended, series.refit, rtol=1e-6, atol=1e-9)


def drawable(result: GapResult) -> list[GapSeries]:
    """Return the series that have enough rows for a figure."""
    return [series for series in result.series if len(series.time) > 1]


def held_out_words(result: GapResult, joint: str) -> str:
    """Return the gaps at a joint of nominal model, refit and extended model as one phrase."""
    stages = [stage for stage in result.stages if is_number(stage.torque_rms.get(joint))]
    unit = torque_unit(result, joint)
    sizes = [
        f"{_STAGES.get(stage.name, 'extended')} {number(stage.torque_rms[joint])} {unit}"
        for stage in stages
        if stage.name in _STAGES or stage is stages[-1]
    ]
    return f"gap, rms on held-out data: {', '.join(sizes)}" if sizes else ""


def untestable(result: GapResult) -> list[tuple[str, str, str, str, str]]:
    """Return effect, joints, reason, smallest visible size, motion needed; equal reasons merged."""
    groups: dict[tuple[str, str, str], list[NotTestable]] = {}
    for limit in result.not_testable:
        groups.setdefault((limit.effect, limit.reason, limit.excitation_needed), []).append(limit)
    rows = []
    for (effect, reason, needed), group in groups.items():
        joints = ", ".join(limit.joint for limit in group if limit.joint) or "all"
        smallest = group[0].smallest
        if any(limit.smallest != smallest for limit in group):
            smallest = ", ".join(f"{limit.joint}: {limit.smallest or 'at no size'}"
                                 for limit in group)  # fmt: skip
        why, motion = (sentence(words, result.joints) for words in (reason, needed))
        rows.append((effect_words(effect), joints, why, smallest or "at no size", motion))
    return rows


def worth_seeing(result: Result, most: int = 2) -> set[str]:
    """Return the few joints to show unfolded: those with causes, else the worst.

    For an identification, those with the largest residual relative to their torque.
    """
    if isinstance(result, IdentificationResult):
        sizes = {residual.joint: residual.relative_percent or 0.0 for residual in result.residuals}
        named: list[str] = []
    else:
        sizes = {joint_gap.joint: joint_gap.share for joint_gap in result.where.joints}
        places = [cause.joint for cause in result.causes if cause.kind == "structural"]
        if result.unexplained is not None:
            places.append(result.unexplained.joint)
        named = [joint for joint in places if joint is not None]
    worst = sorted(result.joints, key=lambda joint: -sizes.get(joint, 0.0))
    return set(list(dict.fromkeys([*named, *worst]))[:most])


def probability_words(cause: Cause) -> str:
    """Return the probability of a cause; a dash where it has none."""
    return "–" if cause.probability is None else percent(min(100.0 * cause.probability, 99.0))


def lacking_row(result: GapResult, cause: Cause) -> tuple[str, str, str, str, str]:
    """Return a row on a cause: effect and joint, held-out gap, share, probability, rivals.

    The share is that of the gap above the noise, with its 95 % interval.
    """
    gap, unit = cause.torque_gap, torque_unit(result, cause.joint)
    share = MISSING
    if is_number(gap.shrinkage) and gap.shrinkage > 0.0:
        share = percent(100.0 * min(gap.shrinkage, 1.0))
        if is_interval(gap.ci95):
            low, high = (round(100.0 * min(max(end, 0.0), 1.0)) for end in gap.ci95)
            share += f" ({low} to {high})"
    rivals = ", ".join(
        f"{effect_at(rival.effect, None if rival.joint == cause.joint else rival.joint)} "
        f"({percent(100.0 * rival.weight)})"
        for rival in cause.indistinguishable_from
    )
    where = effect_at(cause.effect, cause.joint, cause.other_joint)
    size = f"{number(gap.before)} → {number(gap.after)} {unit}"
    return where, size, share, probability_words(cause), rivals or MISSING


def unnamed_error(result: GapResult) -> ParameterError | None:
    """Return the largest parameter error that no cause covers; None if below 1 % of the torque."""
    rest = max(result.parameter_errors, key=lambda error: error.share_of_torque, default=None)
    return None if rest is None or rest.share_of_torque < _LEAST_SHARE else rest


def wrong_numbers(result: GapResult) -> str:
    """Return all parameter errors in one line, with their count; empty without any."""
    wrong = []
    for cause in result.causes:
        if cause.kind != "parametric":
            continue
        words = effect_at(cause.effect, cause.joint)
        first = surest(cause.parameters, 1)
        for name, by in first.items() if cause.joint is not None else ():
            size = with_interval(by.value, by.std, by.unit)
            words += f", {parameter_words(cause.effect, name)} {size}"
        if cause.probability is not None:
            words += f" ({probability_words(cause)})"
        wrong.append(words)
    lines = [f"{plural(len(wrong), 'error')}: {'; '.join(wrong)}"] if wrong else []
    rest = unnamed_error(result)
    if rest is not None:
        part = rest.share_of_torque
        share = "more than all" if part > 1.0 else f"up to {percent(100.0 * part)}"
        lines.append(f"{'Further values' if wrong else 'Values'} that no cause names make {share} "
                     f"of the torque, at {rest.joint}")  # fmt: skip
    return ". ".join(lines)
