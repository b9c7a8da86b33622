"""Estimates compared: interval of each essential parameter, least squares, refined, given."""

from typing import Any

import numpy as np

from idim_iv_ros.identification.result import IdentificationResult, ParameterEstimate
from idim_iv_ros.report.figures import BLUE, GREEN, GREY, INK, ORANGE, axis, embed, figure, legend
from idim_iv_ros.report.markup import Html, tag
from idim_iv_ros.report.numerals import INTERVAL, known

_LARGEST_SPAN = 100.0  # percent; what lies further out is drawn at the edge
_ROW = 19


def forest_plot(result: IdentificationResult) -> Html | None:
    """Return the plot, or None where no parameter is essential and different from zero."""
    shown = [p for p in result.parameters if p.essential and known(p.value) and p.value != 0.0]
    if not shown:
        return None
    refined = {} if result.refined is None else {p.name: p for p in result.refined.parameters}
    half = [INTERVAL * (p.relative_std_percent or 0.0) for p in shown]
    least_squares = [
        p.ordinary_ls_value if result.estimator == "idim-ls" else p.ls_value for p in shown
    ]
    series: list[tuple[str, str, str, list[float | None]]] = [
        (
            "LS",
            ORANGE,
            "square-open",
            [_shift(p, v) for p, v in zip(shown, least_squares, strict=True)],
        )
    ]
    if refined:
        values = [refined[p.name].value if p.name in refined else None for p in shown]
        shifts = [_shift(p, v) for p, v in zip(shown, values, strict=True)]
        series.append(("refined", GREEN, "diamond", shifts))
    if any(known(p.given_value) for p in shown):
        series.append(("given", INK, "x-thin", [_shift(p, p.given_value) for p in shown]))
    limit = _limit(half, [shifts for *_, shifts in series])
    names = [p.name for p in shown]
    data = [_intervals(names, half, limit)]
    data += [_marks(names, *each, limit) for each in series]
    axes = {
        "xaxis": axis(
            "Difference from the estimate, % of the estimate",
            range=[-1.04 * limit, 1.04 * limit],
            zeroline=True,
            zerolinecolor=GREY,
        ),
        "yaxis": axis(autorange="reversed", type="category", dtick=1, showgrid=True),
    }
    words = "least squares, refined and given values relative to the estimate"
    return tag(
        "div",
        tag("h3", "Estimates compared"),
        legend(
            ("line", BLUE, "estimate and its 95 % interval"),
            *(
                (f"sign {symbol}", colour, _words(name, result))
                for name, colour, symbol, _ in series
            ),
            ("sign arrow", INK, "beyond the edge (move the pointer there for its value)"),
        ),
        embed(figure(data, axes), "forest", 70 + _ROW * max(3, len(shown)), words),
        css="plot",
    )


def _words(name: str, result: IdentificationResult) -> str:
    if name == "LS":
        return "ordinary LS" if result.estimator == "idim-ls" else "IDIM-LS"
    return "given (CAD)" if name == "given" else name


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


def _marks(
    names: list[str],
    word: str,
    colour: str,
    symbol: str,
    shifts: list[float | None],
    limit: float,
) -> dict[str, Any]:
    places, symbols = [], []
    for shift in shifts:
        outside = shift is not None and abs(shift) > limit
        places.append(float(np.clip(shift, -limit, limit)) if shift is not None else None)
        arrow = "triangle-right" if (shift or 0.0) > 0.0 else "triangle-left"
        symbols.append(arrow if outside else symbol)
    return {
        "type": "scatter",
        "mode": "markers",
        "x": places,
        "y": names,
        "customdata": shifts,
        "marker": {
            "color": colour,
            "size": 8,
            "symbol": symbols,
            "line": {"color": colour, "width": 1.5},
        },
        "hovertemplate": f"%{{y}}: {word} %{{customdata:+.3g}} %<extra></extra>",
    }
