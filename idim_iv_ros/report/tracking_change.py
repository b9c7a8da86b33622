"""The tracking error before and after a cause, wherever a diagnosis keeps it."""

import math
from dataclasses import dataclass

from idim_iv_ros.diagnosis.result import Cause, Gap, GapResult, Stage
from idim_iv_ros.report.gap_words import small_unit, stage_words
from idim_iv_ros.report.numerals import known

_CONTROL_LAW = "controller_mismatch"


@dataclass(frozen=True)
class TrackingChange:
    """Tracking error of a cause.

    Attributes
    ----------
    gap : Gap or None
        Before and after, rad (m); None where it is not known.
    words : str
        What it is the change of, or why it is not known; empty where it is the cause's own.
    """

    gap: Gap | None
    words: str


def tracking_change(result: GapResult, cause: Cause) -> TrackingChange:
    """Return the tracking error with and without a cause.

    A structural cause has its own. Wrong numbers are simulated together, in the refit, and their
    change is that of its stage.
    """
    if cause.simulation_gap is not None:
        return TrackingChange(cause.simulation_gap, "")
    if cause.effect == _CONTROL_LAW:
        return TrackingChange(None, "the loop is simulated with the configured control law only")
    stages = _stages(result, cause)
    if stages is None:
        return TrackingChange(None, "no closed loop was simulated")
    before, after = stages
    for stage in (before, after):
        if stage.tracking_rms is None:
            why = f": {stage.note}" if stage.note else ""
            return TrackingChange(None, f"{stage_words(stage.name)} not simulated{why}")
    one, two = (_error(result, stage, cause.joint) for stage in (before, after))
    if one is None or two is None:
        return TrackingChange(None, "see each joint under “How far the gap shrinks”")
    words = f"{stage_words(before.name)} → {stage_words(after.name)}"
    if cause.kind == "parametric":
        words += ", in which all wrong numbers are corrected together"
    shrinkage = 1.0 - two / one if one > 0.0 else None
    return TrackingChange(Gap(one, two, None, shrinkage, None), words)


def _stages(result: GapResult, cause: Cause) -> tuple[Stage, Stage] | None:
    """Return the stages before and after a cause."""
    own = f"+{cause.effect}" if cause.joint is None else f"+{cause.effect}[{cause.joint}]"
    names = [stage.name for stage in result.stages]
    if own in names:
        after = names.index(own)
    elif cause.kind == "parametric" and "refit" in names:
        after = names.index("refit")
    else:
        return None
    return (result.stages[after - 1], result.stages[after]) if after > 0 else None


def _error(result: GapResult, stage: Stage, joint: str | None) -> float | None:
    """Of a joint, or of all (root of the sum of squares) where they have one unit."""
    errors = stage.tracking_rms or {}
    if joint is not None:
        error = errors.get(joint)
        return error if known(error) else None
    if " or " in small_unit(result, None) or not all(known(each) for each in errors.values()):
        return None
    return math.sqrt(sum(each**2 for each in errors.values()))
