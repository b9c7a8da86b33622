"""Sections on the causes of a gap or of a change: size, evidence, and indistinguishable causes."""

from typing import Any

from idim_iv_ros.diagnosis.result.document import GapResult
from idim_iv_ros.diagnosis.result.recordings import ContrastResult
from idim_iv_ros.effects.cause import surest
from idim_iv_ros.excitation.segments import separating_motion
from idim_iv_ros.report.advice import FAMILIES, contrast_headline, contrast_steps
from idim_iv_ros.report.gap_words import hint_words
from idim_iv_ros.report.section import Report, Section


def _context(report: Report[GapResult]) -> dict[str, Any]:
    result = report.result
    rest = result.unexplained
    likeliest = None if rest is None else rest.likeliest(result.hints)
    return {
        "separating_motion": separating_motion,
        "surest": surest,
        "family": "" if rest is None else FAMILIES[rest.family],
        "likeliest": likeliest and hint_words(likeliest),
    }


CAUSES = Section("Causes", "causes", "causes.html.j2", _context)


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
    }


CONTRAST = Section("What changed", "contrast", "contrast.html.j2", _contrast)
