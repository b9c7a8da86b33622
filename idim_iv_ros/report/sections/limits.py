"""What this recording cannot show."""

from typing import Any

from idim_iv_ros.diagnosis.result import GapResult
from idim_iv_ros.report.gap_words import effect_words, untestable
from idim_iv_ros.report.numerals import sentence
from idim_iv_ros.report.section import Report, Section


def _context(report: Report[GapResult]) -> dict[str, Any]:
    result = report.result
    return {
        "untestable": [
            (
                effect_words(effect.effect),
                effect.joints or "all",
                sentence(effect.reason, result.joints),
                effect.smallest or "at no size",
                sentence(effect.excitation_needed, result.joints),
            )
            for effect in untestable(result)
        ],
    }


LIMITS = Section(
    "Limits",
    "limits",
    "limits.html.j2",
    _context,
    "what this recording cannot show, and which motion would",
)
