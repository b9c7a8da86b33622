"""The parameters: value, interval, and what least squares and the nominal model say."""

import re
from dataclasses import dataclass
from typing import Any

import numpy as np

from idim_iv_ros.identification.result import (
    IMPOSSIBLE,
    IdentificationResult,
    ParameterEstimate,
    RefinedEstimate,
)
from idim_iv_ros.report.advice import verdict_badge
from idim_iv_ros.report.figures import (
    BLUE,
    GREEN,
    GREY,
    INK,
    ORANGE,
    Figure,
    Mark,
    axis,
    layout,
)
from idim_iv_ros.report.numerals import INTERVAL, beside, known, measured, number, percent
from idim_iv_ros.report.section import Report, Section

POORLY_KNOWN_PERCENT = 30.0
_LONG_TABLE = 20
_LARGEST_SPAN = 100.0  # percent; what lies further out is drawn at the edge
_ROW = 19


def _context(report: Report[IdentificationResult]) -> dict[str, Any]:
    result = report.result
    refined = {} if result.refined is None else {p.name: p for p in result.refined.parameters}
    ordered = sorted(result.parameters, key=lambda parameter: not parameter.essential)
    minor = sum(not parameter.essential for parameter in ordered)
    ordinary = result.estimator == "idim-ls"
    impossible = [p.name for p in result.parameters if IMPOSSIBLE in (p.remark, p.essential_remark)]
    figure = _forest(result)
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
        "with_essential": any(known(p.essential_value) for p in result.parameters),
        "with_refined": bool(refined),
        "with_given": any(known(p.given_value) for p in result.parameters),
        "essential": len(ordered) - minor,
        "minor": minor,
        "folded": minor > 0 and len(ordered) > _LONG_TABLE,
        "rows": [_row(entry, refined.get(entry.name), ordinary) for entry in ordered],
        "figure": figure,
        "legend": _legend(result) if figure else [],
    }


@dataclass(frozen=True)
class Cell:
    """A number as text, and what its column is sorted by."""

    text: str
    key: float | None


def _row(
    parameter: ParameterEstimate, refined: RefinedEstimate | None, ordinary: bool
) -> dict[str, Any]:
    relative = parameter.relative_std_percent
    poor = relative is None or not known(relative) or relative > POORLY_KNOWN_PERCENT
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
        "ls": _cell(beside(ls_value, std), ls_value),
        "given": _cell(beside(given, std) if known(given) else number(None), given),
    }


def _cell(text: str, value: float | None) -> Cell:
    return Cell(text, value if known(value) else None)


def _measured(value: float | None, std: float | None) -> Cell:
    return _cell(" ".join(filter(None, measured(value, std))), value)


def _typeset(expression: str) -> str:
    """Keep each term on one line: its sign, its factor and its parameter."""
    text = expression.replace(" - ", " − ").replace("− ", "−\N{NO-BREAK SPACE}")
    text = text.replace("+ ", "+\N{NO-BREAK SPACE}")
    return re.sub(r"(?<=[0-9.]) (?=[A-Za-z])", "\N{NO-BREAK SPACE}", text)


@dataclass(frozen=True)
class _Series:
    """Another estimate of the parameters, in percent of the estimate."""

    name: str
    colour: str
    symbol: str
    shifts: list[float | None]


def _series(result: IdentificationResult, shown: list[ParameterEstimate]) -> list[_Series]:
    refined = {} if result.refined is None else {p.name: p for p in result.refined.parameters}
    ordinary = result.estimator == "idim-ls"
    ls = [_shift(p, p.ordinary_ls_value if ordinary else p.ls_value) for p in shown]
    series = [_Series("ordinary LS" if ordinary else "IDIM-LS", ORANGE, "square-open", ls)]
    if refined:
        values = [refined[p.name].value if p.name in refined else None for p in shown]
        shifts = [_shift(p, value) for p, value in zip(shown, values, strict=True)]
        series.append(_Series("refined", GREEN, "diamond", shifts))
    if any(known(p.given_value) for p in shown):
        given = [_shift(p, p.given_value) for p in shown]
        series.append(_Series("given (nominal model)", INK, "x-thin", given))
    return series


def _shown(result: IdentificationResult) -> list[ParameterEstimate]:
    return [p for p in result.parameters if p.essential and known(p.value) and p.value != 0.0]


def _legend(result: IdentificationResult) -> list[Mark]:
    return [
        Mark("line", BLUE, "estimate and its 95 % interval"),
        *(
            Mark(f"sign {series.symbol}", series.colour, series.name)
            for series in _series(result, _shown(result))
        ),
        Mark("sign arrow", INK, "beyond the edge (move the pointer there for its value)"),
    ]


def _forest(result: IdentificationResult) -> Figure | None:
    """Other estimates beside the interval of each essential parameter that is not zero."""
    shown = _shown(result)
    if not shown:
        return None
    half = [INTERVAL * (p.relative_std_percent or 0.0) for p in shown]
    series = _series(result, shown)
    limit = _limit(half, [part.shifts for part in series])
    names = [p.name for p in shown]
    data = [_intervals(names, half, limit), *(_marks(names, each, limit) for each in series)]
    axes = {
        "xaxis": axis(
            "Difference from the estimate, % of the estimate",
            range=[-1.04 * limit, 1.04 * limit],
            zeroline=True,
            zerolinecolor=GREY,
        ),
        "yaxis": axis(range=[len(shown) - 0.4, -0.6], type="category", dtick=1, showgrid=True),
    }
    words = "Other estimates and given values relative to the estimate"
    return Figure("forest", 70 + _ROW * max(3, len(shown)), words, data, layout(axes))


def _shift(parameter: ParameterEstimate, value: float | None) -> float | None:
    if value is None or not known(value):
        return None
    return 100.0 * (value - parameter.value) / abs(parameter.value)


def _limit(half: list[float], shifts: list[list[float | None]]) -> float:
    """Half-width of the axis, percent: all intervals and most marks are inside."""
    marks = [abs(shift) for each in shifts for shift in each if shift is not None]
    wanted = max(1.2 * float(np.percentile(half, 90)), 1.1 * float(np.median([*marks, 0.0])), 5.0)
    return min(wanted, _LARGEST_SPAN)


def _intervals(names: list[str], half: list[float], limit: float) -> dict[str, Any]:
    return {
        "type": "scatter",
        "mode": "markers",
        "x": [0.0] * len(names),
        "y": names,
        "customdata": [round(each, 3) for each in half],
        "error_x": {
            "type": "data",
            "array": [min(each, 2.0 * limit) for each in half],
            "color": BLUE,
            "thickness": 2,
            "width": 4,
        },
        "marker": {"color": BLUE, "size": 6},
        "hovertemplate": "%{y}: estimate ± %{customdata:.3g} %<extra></extra>",
    }


def _marks(names: list[str], series: _Series, limit: float) -> dict[str, Any]:
    places, symbols = [], []
    for shift in series.shifts:
        outside = shift is not None and abs(shift) > limit
        places.append(float(np.clip(shift, -limit, limit)) if shift is not None else None)
        arrow = "triangle-right" if (shift or 0.0) > 0.0 else "triangle-left"
        symbols.append(arrow if outside else series.symbol)
    return {
        "type": "scatter",
        "mode": "markers",
        "x": places,
        "y": names,
        "customdata": series.shifts,
        "marker": {
            "color": series.colour,
            "size": 8,
            "symbol": symbols,
            "line": {"color": series.colour, "width": 1.5},
        },
        "hovertemplate": f"%{{y}}: {series.name} %{{customdata:+.3g}} %<extra></extra>",
    }


PARAMETERS = Section("Parameters", "parameters", "parameters.html.j2", _context)
