"""The parameters: estimate, least squares and nominal model, and the nearest physical set."""

import re
from typing import Any, NamedTuple

from idim_iv_ros.identification.result import (
    IMPOSSIBLE,
    IdentificationResult,
    ParameterEstimate,
    RefinedEstimate,
)
from idim_iv_ros.report.advice import verdict_badge
from idim_iv_ros.report.numerals import is_number, measured, number, percent, with_digits_of
from idim_iv_ros.report.section import Report, Section

POORLY_KNOWN_PERCENT = 30.0
_LONG_TABLE = 20


def _context(report: Report[IdentificationResult]) -> dict[str, Any]:
    result = report.result
    refined = {} if result.refined is None else {p.name: p for p in result.refined.parameters}
    ordered = sorted(result.parameters, key=lambda parameter: not parameter.essential)
    minor = sum(not parameter.essential for parameter in ordered)
    ordinary = result.estimator == "idim-ls"
    impossible = [p.name for p in result.parameters if IMPOSSIBLE in (p.remark, p.essential_remark)]
    return {
        "misspecified": [
            residual.joint
            for residual in result.residuals
            if verdict_badge(residual.verdict)[0] == "bad"
        ],
        "impossible": impossible,
        "moved": () if result.refined is None else result.refined.moved,
        "poor": POORLY_KNOWN_PERCENT,
        "fit": result.fit,
        "alpha": result.instruments.alpha,
        "ls": "Ordinary LS" if ordinary else "IDIM-LS",
        "with_essential": any(is_number(p.essential_value) for p in result.parameters),
        "with_refined": bool(refined),
        "with_given": any(is_number(p.given_value) for p in result.parameters),
        "essential": len(ordered) - minor,
        "minor": minor,
        "folded": minor > 0 and len(ordered) > _LONG_TABLE,
        "rows": [_row(entry, refined.get(entry.name), ordinary) for entry in ordered],
    }


class Cell(NamedTuple):
    """A number as text, and what its column is sorted by."""

    text: str
    key: float | None


def _row(
    parameter: ParameterEstimate, refined: RefinedEstimate | None, ordinary: bool
) -> dict[str, Any]:
    relative = parameter.relative_std_percent
    poor = relative is None or not is_number(relative) or relative > POORLY_KNOWN_PERCENT
    ls_value = parameter.ordinary_ls_value if ordinary else parameter.ls_value
    given, std = parameter.given_value, parameter.std
    essential = Cell("left out", None)
    if parameter.essential:
        essential = _measured(parameter.essential_value, parameter.essential_std)
    return {
        "name": parameter.name,
        "css": " ".join(
            word for word, on in (("minor", not parameter.essential), ("poor", poor)) if on
        ),
        "expression": _typeset(parameter.expression),
        "unit": parameter.unit,
        "estimate": _measured(parameter.value, std),
        "relative": _cell(percent(relative), relative),
        "remark": parameter.remark,
        "essential": essential,
        "refined": _measured(None, None)
        if refined is None
        else _measured(refined.value, refined.std),
        "ls": _cell(with_digits_of(ls_value, std), ls_value),
        "given": _cell(with_digits_of(given, std) if is_number(given) else number(None), given),
    }


def _cell(text: str, value: float | None) -> Cell:
    return Cell(text, value if is_number(value) else None)


def _measured(value: float | None, std: float | None) -> Cell:
    return _cell(" ".join(filter(None, measured(value, std))), value)


def _typeset(expression: str) -> str:
    """Keep each term on one line: its sign, its factor and its parameter."""
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
