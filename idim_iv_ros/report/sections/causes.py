"""Sections on the causes of a gap or of a change: size, evidence, and indistinguishable causes."""

from typing import Any

from idim_iv_ros.diagnosis.result.causes import Cause, Gap, Hint
from idim_iv_ros.diagnosis.result.document import GapResult
from idim_iv_ros.diagnosis.result.recordings import ContrastResult
from idim_iv_ros.effects.cause import surest
from idim_iv_ros.effects.registry import parameter_words
from idim_iv_ros.excitation.segments import separating_motion
from idim_iv_ros.report.advice import FAMILIES, contrast_headline, contrast_steps
from idim_iv_ros.report.gap_words import effect_at, hint_words, small_unit, torque_unit
from idim_iv_ros.report.numerals import (
    is_interval,
    is_number,
    number,
    percent,
    sentence,
    with_interval,
    with_unit,
)
from idim_iv_ros.report.section import Report, Section

_MOST_NUMBERS = 4  # of a hint


def _card(result: GapResult, cause: Cause) -> dict[str, Any]:
    """Return the variables of a cause's card: the cause with its gaps before and after.

    A parameter error is judged on all samples, while the sizes of the stages are on held-out data:
    both for the same models would contradict each other, so that it has no sizes.
    """
    if cause.kind == "parametric":
        gaps = [_gap("Torque gap", cause.torque_gap, None, "", "on all samples")]
    else:
        gaps = [_gap("Torque gap", cause.torque_gap, 1.0, torque_unit(result, cause.joint), "")]
    if cause.simulation_gap is not None:
        unit = small_unit(result, cause.joint)
        gaps.append(_gap("Tracking error", cause.simulation_gap, 1e3, unit, ""))
    return {"cause": cause, "gaps": gaps}


def hint_row(result: GapResult, hint: Hint) -> tuple[str, str, str, str]:
    """Return effect with its joint, its numbers, folds that chose it, and why it is only a hint."""
    title = effect_at(hint.effect, hint.joint, hint.other_joint)
    numbers = ", ".join(
        f"{parameter_words(hint.effect, name)} {with_interval(by.value, by.std, by.unit)}"
        for name, by in surest(hint.parameters, _MOST_NUMBERS).items()
    )
    reason = sentence(hint.reason, result.joints)
    return title[:1].upper() + title[1:], numbers, hint.chosen_in_folds or "–", reason


def _gap(title: str, gap: Gap, factor: float | None, unit: str, which: str) -> dict[str, Any]:
    """Return a gap before and after as variables of the template, with a bar of its shrinkage."""
    sizes = ""
    if factor is not None:
        before, after = (with_unit(factor * level, unit) for level in (gap.before, gap.after))
        sizes = f"{before} → {after}"
    return {
        "title": title,
        "sizes": sizes,
        "words": "; ".join(filter(None, (_shrinkage(gap), which))),
        "share": _percent_inside(gap.shrinkage) if is_number(gap.shrinkage) else None,
        "interval": None if gap.ci95 is None else tuple(map(_percent_inside, gap.ci95)),
    }


def _percent_inside(share: float | None) -> float:
    """Return a share in percent, limited to 0 to 100."""
    return round(100.0 * min(max(share, 0.0), 1.0), 1) if is_number(share) else 0.0


def _shrinkage(gap: Gap) -> str:
    if not is_number(gap.shrinkage):
        return "its share is not known"
    interval = ""
    if is_interval(gap.ci95):
        low, high = (number(100.0 * bound, 2) for bound in gap.ci95)
        interval = f" ({low} to {high} %)"
    of = "of the gap above the noise floor" if gap.noise_floor is not None else "of the gap"
    return f"removes {percent(100.0 * gap.shrinkage)}{interval} {of}"


def _context(report: Report[GapResult]) -> dict[str, Any]:
    result = report.result
    rest = result.unexplained
    likeliest = None if rest is None else rest.likeliest(result.hints)
    return {
        "cards": [_card(result, cause) for cause in result.causes],
        "separating_motion": separating_motion,
        "hints": [hint_row(result, hint) for hint in result.hints],
        "family": "" if rest is None else FAMILIES[rest.family],
        "likeliest": likeliest and hint_words(likeliest),
    }


CAUSES = Section("Causes", "causes", "causes.html.j2", _context)


def contrast_rows(result: GapResult, contrast: ContrastResult) -> list[tuple[str, ...]]:
    """Return rows: joint, rms that each model leaves of the second set, share, unexplained."""
    rows = []
    for joint in contrast.joints:
        unit, share = torque_unit(result, joint.joint), percent(100.0 * joint.share_of_torque)
        errors = (with_unit(value, unit) for value in (joint.before, joint.after, joint.own))
        rows.append((joint.joint, *errors, share, with_unit(joint.unexplained, unit)))
    return rows


def contrast_badge(contrast: ContrastResult) -> tuple[str, str, str]:
    """Return CSS class, sign and words of the comparison's answer."""
    if contrast.differs is None:
        return "open", "?", "not all joints could be compared"
    if not contrast.differs:
        return "good", "✓", "no difference"
    if contrast.causes:
        return "fair", "≠", "the sets differ"
    return "open", "?", "the sets differ, and nothing in the catalogue explains it"


def _contrast(report: Report[GapResult]) -> dict[str, Any] | None:
    result = report.result
    contrast = result.contrast
    if contrast is None:
        return None
    return {
        "badge": contrast_badge(contrast),
        "headline": contrast_headline(result, contrast),
        "steps": contrast_steps(contrast, report.files),
        "joints": contrast_rows(result, contrast),
    }


CONTRAST = Section("What changed", "contrast", "contrast.html.j2", _contrast)
