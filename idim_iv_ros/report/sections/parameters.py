"""Sections on the parameters: estimate, least squares, nominal model, nearest physical set."""

import re
from typing import Any

from idim_iv_ros.identification.result import IMPOSSIBLE, IdentificationResult
from idim_iv_ros.report.advice import verdict_badge
from idim_iv_ros.report.numerals import is_number
from idim_iv_ros.report.section import Report, Section

_IMPRECISE_PERCENT = 30.0
_LONG_TABLE = 20


def _context(report: Report[IdentificationResult]) -> dict[str, Any]:
    result = report.result
    refined = {} if result.refined is None else {p.name: p for p in result.refined.parameters}
    ordered = sorted(result.parameters, key=lambda parameter: not parameter.essential)
    minor = sum(not parameter.essential for parameter in ordered)
    return {
        "misspecified": [
            residual.joint
            for residual in result.residuals
            if verdict_badge(residual.verdict)[0] == "bad"
        ],
        "impossible": [
            p.name for p in result.parameters if IMPOSSIBLE in (p.remark, p.essential_remark)
        ],
        "poor": _IMPRECISE_PERCENT,
        "with_essential": any(is_number(p.essential_value) for p in result.parameters),
        "with_given": any(is_number(p.given_value) for p in result.parameters),
        "essential": len(ordered) - minor,
        "minor": minor,
        "folded": minor > 0 and len(ordered) > _LONG_TABLE,
        "ordered": ordered,
        "refined": refined,
        "ordinary": result.estimator == "idim-ls",
        "typeset": _typeset,
    }


def _typeset(expression: str) -> str:
    """Return an expression that can break between terms only."""
    text = expression.replace(" - ", " − ").replace("− ", "−\N{NO-BREAK SPACE}")
    text = text.replace("+ ", "+\N{NO-BREAK SPACE}")
    return re.sub(r"(?<=[0-9.]) (?=[A-Za-z])", "\N{NO-BREAK SPACE}", text)


PARAMETERS = Section("Parameters", "parameters", "parameters.html.j2", _context)


_LARGE = 0.1  # σ from which the change of a base parameter is listed


def _physical(report: Report[Any]) -> dict[str, Any] | None:
    physical = report.result.physical
    if physical is None and not report.result.why_no_physical:
        return None
    moved = [
        parameter
        for parameter in (physical.base if physical is not None else ())
        if is_number(parameter.deviations) and abs(parameter.deviations) >= _LARGE
    ]
    return {
        "physical": physical,
        "moved": sorted(moved, key=lambda parameter: -abs(parameter.deviations)),
        "numbers": report.files.here(report.numbers),
    }


PHYSICAL: Section[Any] = Section(
    "Physical",
    "physical",
    "physical.html.j2",
    _physical,
    "masses, centres and inertias that a simulator can hold",
)
