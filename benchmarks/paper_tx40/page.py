"""The report: each number beside the paper's."""

from collections.abc import Sequence
from importlib import resources

import numpy as np
from idim_iv_ros.report.markup import Html, join, section, tag
from idim_iv_ros.report.script import SCRIPT
from plotly.offline import get_plotlyjs

from benchmarks.paper_tx40.claims import CLAIMS
from benchmarks.paper_tx40.experiment import (
    APPROPRIATE,
    INAPPROPRIATE,
    MODEL_ERROR,
    SITUATIONS,
    TITLES,
    Reproduction,
)
from benchmarks.paper_tx40.published import TABLE_1, TABLE_2, TABLE_3
from idim_iv_ros import IdentificationResult
from idim_iv_ros.report.figures import BLUE, INK, ORANGE, Figure, axis, embed, figure, typed
from idim_iv_ros.report.numerals import cell, fixed, number

_FIGURES = ((APPROPRIATE, 1), (INAPPROPRIATE, 3), (MODEL_ERROR, 5))
_BINS = 41


def page(runs: Sequence[Reproduction]) -> str:
    """Return the comparison as one self-contained HTML document."""
    css = resources.files("idim_iv_ros.report").joinpath("report.css").read_text("utf-8")
    head = tag(
        "head",
        tag("meta", charset="utf-8"),
        tag("meta", name="viewport", content="width=device-width, initial-scale=1"),
        tag("title", "The paper's experiment on a simulated TX40"),
        tag("style", Html(css)),
        tag("script", Html(get_plotlyjs())),
    )
    first = runs[0]
    body = tag(
        "body",
        tag(
            "header",
            tag("h1", "TX40", tag("span", " the paper's experiment, simulated")),
            tag(
                "p",
                "Section V of Brunot, Janot, Carrillo and Garnier on a simulated robot whose true "
                "parameters are those of the paper's Table 1; 10 s at 5 kHz, noise seeds "
                f"{', '.join(str(run.seed) for run in runs)}.",
            ),
        ),
        tag(
            "main",
            _sentences(runs),
            _table_1(first),
            _table_2(first),
            _table_3(first),
            _figures(first),
            _reports(runs),
        ),
        tag("script", Html(SCRIPT)),
    )
    return join(Html("<!DOCTYPE html>\n"), tag("html", head, body, lang="en"), "\n")


def _sentences(runs: Sequence[Reproduction]) -> Html:
    rows = []
    for claim in CLAIMS:
        outcomes = [claim.measure(run) for run in runs]
        holds = sum(outcome.holds for outcome in outcomes)
        several = len({outcome.ours for outcome in outcomes}) > 1
        ours = [
            tag("div", f"seed {run.seed}: {outcome.ours}" if several else outcome.ours)
            for run, outcome in zip(runs, outcomes, strict=True)
        ]
        words = f"{holds} of {len(runs)}"
        remark = tag("div", claim.remark, css="explanation") if claim.remark else ""
        rows.append(
            tag(
                "tr",
                tag("td", claim.section),
                tag("td", claim.sentence, remark, css="words"),
                tag("td", claim.paper, css="words"),
                tag("td", ours if several else ours[:1], css="words"),
                tag("td", tag("b", words) if holds == len(runs) else words),
            )
        )
    heads = [tag("th", text, scope="col") for text in ("", "Sentence", "Paper", "Here", "Holds")]
    table = tag("table", tag("thead", tag("tr", heads)), tag("tbody", rows))
    return section(
        "Sentence by sentence",
        "sentences",
        tag(
            "p",
            "The robot, its gains and its noise were fixed before anything was identified. The "
            "motion is a random one with the peak speeds of a real record of this robot; motions "
            "designed for their condition number alone were slower, and the inertias of the wrist "
            "could not be told on them. Where a sentence does not hold on every seed, the reason "
            "stands below it.",
            css="explanation",
        ),
        table,
    )


def _table_1(run: Reproduction) -> Html:
    right = {p.name: p for p in run.results[APPROPRIATE].parameters}
    dense = {p.name: p for p in run.results[INAPPROPRIATE].parameters}
    rows = []
    for name, (value, app, inap) in TABLE_1.items():
        ours, oversampled = right[name], dense[name]
        rows.append(
            tag(
                "tr",
                tag("th", name, scope="row"),
                cell(fixed(value, 2)),
                cell(number(ours.value, 3)),
                cell(f"{(ours.value - run.truth[name]) / ours.std:+.1f}"),
                cell(number(app, 2)),
                cell(number(100.0 * ours.white_std / abs(ours.value), 2)),
                cell(number(100.0 * ours.std / abs(ours.value), 2)),
                cell(number(inap, 2)),
                cell(number(100.0 * oversampled.white_std / abs(oversampled.value), 2)),
                tag("td", ours.unit),
            )
        )
    heads = (
        "",
        "Table 1 (truth here)",
        "estimate",
        "off by, σ",
        "App, paper %",
        "App, here % (white)",
        "App, here % (coloured)",
        "Inap, paper %",
        "Inap, here % (white)",
        "unit",
    )
    return _table(
        "Table 1: estimates and relative standard deviations",
        "table-1",
        heads,
        rows,
        "White: computed as if the residual were white, as the paper does. Coloured: with the "
        "colour of the residual taken into account. All 60 base parameters are estimated.",
    )


def _table_2(run: Reproduction) -> Html:
    refined = run.results[INAPPROPRIATE].refined
    assert refined is not None
    ours = {p.name: p for p in refined.parameters}
    rows = [
        tag(
            "tr",
            tag("th", name, scope="row"),
            cell(fixed(value, 2)),
            cell(number(ours[name].value, 3)),
            cell(number(percent, 3)),
            cell(number(100.0 * ours[name].std / abs(ours[name].value), 3)),
            tag("td", ours[name].unit),
        )
        for name, (value, percent) in TABLE_2.items()
    ]
    return _table(
        "Table 2: refined estimates after inappropriate filtering",
        "table-2",
        ("", "paper", "here", "%σ, paper", "%σ, here", "unit"),
        rows,
        "",
    )


def _table_3(run: Reproduction) -> Html:
    ours = {p.name: p for p in run.results[MODEL_ERROR].parameters}
    rows = [
        tag(
            "tr",
            tag("th", name, scope="row"),
            cell(fixed(run.truth[name], 2)),
            cell(fixed(value, 2)),
            cell(number(ours[name].value, 3)),
            cell(f"{(ours[name].value - run.truth[name]) / ours[name].std:+.1f}"),
            cell(number(percent, 3)),
            cell(number(100.0 * ours[name].std / abs(ours[name].value), 3)),
            tag("td", ours[name].unit),
        )
        for name, (value, percent) in TABLE_3.items()
    ]
    return _table(
        "Table 3: estimates with gravity and off-diagonal inertias left out",
        "table-3",
        ("", "Table 1", "Table 3", "here", "off Table 1 by, σ", "%σ, paper", "%σ, here", "unit"),
        rows,
        "",
    )


def _table(
    title: str, anchor: str, heads: Sequence[str], rows: Sequence[Html], explanation: str
) -> Html:
    head = [tag("th", text, scope="col", css="num" if text else None) for text in heads]
    table = tag("table", tag("thead", tag("tr", head)), tag("tbody", rows))
    words = tag("p", explanation, css="explanation") if explanation else ""
    return section(title, anchor, words, table)


def _figures(run: Reproduction) -> Html:
    parts: list[Html] = []
    for name, first in _FIGURES:
        result = run.results[name]
        residual = _pooled(result)
        parts.append(tag("h3", f"{TITLES[name]}: figures {first} and {first + 1}"))
        parts.append(
            embed(_acf(result), f"acf-{name}", 260, f"Autocorrelation of the residuals, {name}")
        )
        parts.append(embed(_histogram(residual), f"histogram-{name}", 260, f"Histogram, {name}"))
    return section("Figures 1 to 6", "figures", *parts)


def _pooled(result: IdentificationResult) -> np.ndarray:
    """Residuals of all joints, each over its standard deviation."""
    return np.concatenate(
        [
            (series.measured - series.predicted) / np.std(series.measured - series.predicted)
            for series in result.series
        ]
    )


def _acf(result: IdentificationResult) -> Figure:
    data = [
        {
            "type": "scatter",
            "mode": "lines+markers",
            "name": residual.joint,
            "x": typed(np.arange(len(residual.acf), dtype=float)),
            "y": typed(residual.acf),
            "marker": {"size": 4},
            "line": {"width": 1},
        }
        for residual in result.residuals
    ]
    bound = float(max(residual.acf_bound for residual in result.residuals))
    band = {
        "type": "rect",
        "xref": "paper",
        "x0": 0,
        "x1": 1,
        "y0": -bound,
        "y1": bound,
        "fillcolor": "rgba(120, 130, 140, 0.2)",
        "line": {"width": 0},
    }
    axes = {"xaxis": axis("Lag, rows"), "yaxis": axis("Autocorrelation", range=[-0.4, 1.05])}
    return figure(data, axes, shapes=[band], showlegend=True)


def _histogram(residual: np.ndarray) -> Figure:
    edges = np.linspace(-5.0, 5.0, _BINS + 1)
    density, _ = np.histogram(residual, edges, density=True)
    middle = 0.5 * (edges[1:] + edges[:-1])
    bars = {
        "type": "bar",
        "x": typed(middle),
        "y": typed(density),
        "marker": {"color": BLUE},
        "name": "residual",
    }
    gaussian = {
        "type": "scatter",
        "mode": "lines",
        "x": typed(middle),
        "y": typed(np.exp(-0.5 * middle**2) / np.sqrt(2.0 * np.pi)),
        "line": {"color": ORANGE, "width": 2},
        "name": "Gaussian",
    }
    axes = {
        "xaxis": axis("Residual over its standard deviation, all joints"),
        "yaxis": axis("Density", zerolinecolor=INK),
    }
    return figure([bars, gaussian], axes, bargap=0.05, showlegend=True)


def _reports(runs: Sequence[Reproduction]) -> Html:
    links = [
        tag(
            "li",
            tag(
                "a", f"seed {run.seed}: {TITLES[name]}", href=f"seed-{run.seed}/{name}/report.html"
            ),
        )
        for run in runs
        for name in SITUATIONS
    ]
    return section("Reports of every identification", "reports", tag("ul", links))
