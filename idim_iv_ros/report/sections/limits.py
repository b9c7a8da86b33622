"""What this recording cannot show, and which effects it cannot distinguish."""

from typing import Any

from idim_iv_ros.diagnosis.result import Confusability, GapResult
from idim_iv_ros.report.gap_words import effect_words, untestable
from idim_iv_ros.report.numerals import fixed, known, percent, sentence
from idim_iv_ros.report.section import Report, Section

_SIMILAR, _SAME = 0.8, 0.95
_NAMED = 4  # pairs in the heading of a matrix


def _context(report: Report[GapResult]) -> dict[str, Any]:
    result = report.result
    few = len(result.confusability) <= 2
    named = {each.joint for each in result.causes}
    return {
        "untestable": [
            (
                effect_words(each.effect),
                each.joints or "all",
                sentence(each.reason, result.joints),
                each.smallest or "at no size",
                sentence(each.excitation_needed, result.joints),
            )
            for each in untestable(result)
        ],
        "matrices": [_matrix(each, few or each.joint in named) for each in result.confusability],
    }


def _matrix(each: Confusability, opened: bool) -> dict[str, Any]:
    count = len(each.effects)
    rows = [
        {
            "effect": effect_words(effect),
            "cells": [_cell(float(each.correlation[k, i]), i == k) for i in range(count)],
            "absorbed": percent(100.0 * float(each.absorbed[k])),
            "smallest": each.smallest[k],
        }
        for k, effect in enumerate(each.effects)
    ]
    return {"joint": each.joint, "pairs": _pairs(each), "rows": rows, "open": opened}


def _pairs(each: Confusability) -> str:
    same = [
        f"{effect_words(first)} and {effect_words(each.effects[i])}"
        for k, first in enumerate(each.effects)
        for i in range(k + 1, len(each.effects))
        if float(each.correlation[k, i]) >= _SAME
    ]
    if not same:
        return "every pair of effects is distinguishable"
    more = f" and {len(same) - _NAMED} more pairs" if len(same) > _NAMED else ""
    return f"may be indistinguishable: {', '.join(same[:_NAMED])}{more}"


def _cell(correlation: float, own: bool) -> dict[str, Any] | None:
    if own or not known(correlation):
        return None
    return {
        "text": fixed(correlation, 2) if correlation >= 0.005 else "0",
        "strength": round(75.0 * max(0.0, correlation - 0.3) / 0.7),
        "similar": correlation >= _SIMILAR,
        "same": correlation >= _SAME,
    }


LIMITS = Section("Limits", "limits", "limits.html.j2", _context)
