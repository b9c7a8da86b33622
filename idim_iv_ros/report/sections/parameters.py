"""The parameters: value, interval, and what least squares and the nominal model say."""

import re
from dataclasses import dataclass

from idim_iv_ros.identification.result import (
    IMPOSSIBLE,
    IdentificationResult,
    ParameterEstimate,
    RefinedEstimate,
)
from idim_iv_ros.report.markup import Html, join, section, tag
from idim_iv_ros.report.numerals import (
    beside,
    cell,
    known,
    measured_cells,
    number,
    p_value,
    percent,
)
from idim_iv_ros.report.sections.forest import forest_plot

POORLY_KNOWN_PERCENT = 30.0
_LONG_TABLE = 20


@dataclass(frozen=True)
class _Columns:
    """Which of the optional columns the table has."""

    essential: bool
    refined: bool
    given: bool
    ls: str


def parameters_section(result: IdentificationResult) -> Html:
    """Return the table of parameters and the plot that compares the estimates."""
    refined = {} if result.refined is None else {p.name: p for p in result.refined.parameters}
    columns = _Columns(
        essential=any(known(p.essential_value) for p in result.parameters),
        refined=bool(refined),
        given=any(known(p.given_value) for p in result.parameters),
        ls="Ordinary LS" if result.estimator == "idim-ls" else "IDIM-LS",
    )
    ordered = sorted(result.parameters, key=lambda parameter: not parameter.essential)
    rows = [_row(parameter, refined.get(parameter.name), columns) for parameter in ordered]
    minor = sum(not parameter.essential for parameter in ordered)
    return section(
        "Parameters",
        "parameters",
        _warnings(result),
        _explanation(result, columns),
        tag(
            "input",
            type="checkbox",
            id="only-essential",
            checked=minor > 0 and len(ordered) > _LONG_TABLE,
        ),
        tag(
            "label",
            f"Show only the {len(ordered) - minor} essential parameters "
            f"(hides {minor} that are not)",
            for_="only-essential",
        )
        if minor
        else None,
        tag(
            "div",
            tag("table", _header(columns), tag("tbody", rows), css="sortable parameters"),
            css="wide",
        ),
        forest_plot(result),
    )


def _warnings(result: IdentificationResult) -> list[Html]:
    found = (_wrong_model(result), _impossible(result), _disagreement(result))
    return [each for each in found if each is not None]


def _impossible(result: IdentificationResult) -> Html | None:
    """Warn of values that no body, drive or friction has."""
    names = [p.name for p in result.parameters if IMPOSSIBLE in (p.remark, p.essential_remark)]
    if not names:
        return None
    return tag(
        "p",
        tag("b", "Some values are physically impossible. "),
        f"{', '.join(names)}: below zero beyond the 95 % interval, though every parameter in the "
        "grouped expression is a mass, a moment of inertia or a friction. The model lacks an "
        "effect that these parameters take up, or the recording does not excite them.",
        css="warning",
    )


def _disagreement(result: IdentificationResult) -> Html | None:
    """Warn where whitening moves an estimate further than noise can (a specification test)."""
    if result.refined is None:
        return None
    if not result.refined.moved:
        return None
    return tag(
        "p",
        tag("b", "Whitening moves some estimates further than noise can. "),
        f"{', '.join(result.refined.moved)}: refined and unrefined estimate differ by more than "
        "3 of their σ. A model error that lives at some frequencies only, often "
        "friction at the reversals, does this; σ does not cover it.",
        css="warning",
    )


def _wrong_model(result: IdentificationResult) -> Html | None:
    wrong = [each.joint for each in result.residuals if each.verdict == "misspecified"]
    if not wrong:
        return None
    return tag(
        "p",
        tag("b", "Do not rely on all of these values. "),
        f"The model or the control law is wrong at {', '.join(wrong)}: estimates that depend on "
        "these joints are biased, and the intervals do not cover that.",
        css="warning",
    )


def _explanation(result: IdentificationResult, columns: _Columns) -> Html:
    fit = result.fit
    sentences = [
        "± is the half-width of the 95 % interval, 1.96 σ; σ takes the colour of the residual "
        "into account. %σ is 100 σ / |value|. "
        f"Grey: not essential, or %σ above {POORLY_KNOWN_PERCENT:.0f} % (poorly known). "
        "Remark: “not significant” where the interval holds zero (what is essential together need "
        "not be significant alone), “physically impossible” where it lies below zero and no part "
        "of the expression may be negative. "
    ]
    if columns.essential:
        sentences.append(
            "“Estimate” has all base parameters in the model; “essential only” just the essential "
            "ones (chosen by an F-test on whitened rows). Take a column as a whole. "
        )
        if known(fit.essential_p_value):
            sentences.append(
                "The data do not tell the two models apart "
                if fit.essential_p_value >= result.instruments.alpha
                else "The parameters left out are jointly significant "
            )
            sentences.append(f"(F-test, p = {p_value(fit.essential_p_value)}). ")
    if columns.refined:
        sentences.append(
            "“Refined” was estimated on rows that the autoregressive filters made white: where "
            "the instruments are valid, these are the deviations to use. "
        )
    if columns.given:
        sentences.append("“Given” is what the URDF and the configuration hold (CAD).")
    return tag("p", sentences, css="explanation")


def _header(columns: _Columns) -> Html:
    heads: list[tuple[str, int, bool]] = [
        ("Name", 1, False),
        ("Grouped expression", 1, False),
        ("Unit", 1, False),
        ("Estimate ± 95 %", 2, True),
        ("%σ", 1, True),
        ("Remark", 1, False),
    ]
    heads += [("Essential only ± 95 %", 2, True)] if columns.essential else []
    heads += [("Refined ± 95 %", 2, True)] if columns.refined else []
    heads += [(columns.ls, 1, True)]
    heads += [("Given", 1, True)] if columns.given else []
    cells, column = [], 0
    for text, width, numeric in heads:
        cells.append(
            tag(
                "th",
                tag("button", text, type="button", title="Sort") if numeric else text,
                scope="col",
                css="num" if numeric else None,
                colspan=str(width) if width > 1 else None,
                data_column=str(column) if numeric else None,
            )
        )
        column += width
    return tag("thead", tag("tr", cells))


def _typeset(expression: str) -> str:
    """Keep each term on one line: its sign, its factor and its parameter."""
    text = expression.replace(" - ", " − ").replace("− ", "−\N{NO-BREAK SPACE}")
    text = text.replace("+ ", "+\N{NO-BREAK SPACE}")
    return re.sub(r"(?<=[0-9.]) (?=[A-Za-z])", "\N{NO-BREAK SPACE}", text)


def _row(parameter: ParameterEstimate, refined: RefinedEstimate | None, columns: _Columns) -> Html:
    relative = parameter.relative_std_percent
    poor = not known(relative) or (relative is not None and relative > POORLY_KNOWN_PERCENT)
    classes = " ".join(
        word for word, on in (("minor", not parameter.essential), ("poor", poor)) if on
    )
    ls_value = parameter.ordinary_ls_value if columns.ls == "Ordinary LS" else parameter.ls_value
    given = parameter.given_value
    cells = [
        tag("th", parameter.name, scope="row"),
        tag("td", _typeset(parameter.expression), css="expression"),
        tag("td", parameter.unit, css="unit"),
        measured_cells(parameter.value, parameter.std),
        cell(percent(relative), relative),
        tag("td", parameter.remark, css="words"),
    ]
    if columns.essential:
        if parameter.essential:
            cells.append(measured_cells(parameter.essential_value, parameter.essential_std))
        else:
            cells.append(join(cell("left out"), tag("td")))
    if columns.refined:
        value, std = (None, None) if refined is None else (refined.value, refined.std)
        cells.append(measured_cells(value, std))
    cells.append(cell(beside(ls_value, parameter.std), ls_value))
    if columns.given:
        text = "0" if given == 0.0 else beside(given, parameter.std)
        cells.append(cell(text if known(given) else number(None), given))
    return tag("tr", cells, css=classes or None)
