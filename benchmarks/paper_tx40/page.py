"""The report: each number beside the paper's."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup

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
from idim_iv_ros.report.figures import BLUE, INK, ORANGE, SHADE, Figure, axis, line, typed
from idim_iv_ros.report.numerals import fixed, number
from idim_iv_ros.report.page import environment, page_html

_TEMPLATE = Path(__file__).with_name("page.html.j2")
_FIGURES = ((APPROPRIATE, 1), (INAPPROPRIATE, 3), (MODEL_ERROR, 5))
_BINS = 41
_HEIGHT = 260


def page(runs: Sequence[Reproduction]) -> str:
    """Return the comparison as one self-contained HTML document."""
    first = runs[0]
    seeds = ", ".join(str(run.seed) for run in runs)
    section = environment().from_string(_TEMPLATE.read_text("utf-8")).render(
        claims=[_claim(claim, runs) for claim in CLAIMS],
        table_1=_table_1(first),
        table_2=_table_2(first),
        table_3=_table_3(first),
        figures=_figures(first),
        reports=[
            (f"seed-{run.seed}/{name}/report.html", f"seed {run.seed}: {TITLES[name]}")
            for run in runs
            for name in SITUATIONS
        ],
    )  # fmt: skip
    return page_html(
        "TX40",
        "the paper's experiment, simulated",
        "Section V of Brunot, Janot, Carrillo and Garnier on a simulated robot whose true "
        f"parameters are those of the paper's Table 1; 10 s at 5 kHz, noise seeds {seeds}.",
        [("paper", "The paper", Markup(section))],
    )


def _claim(claim: Any, runs: Sequence[Reproduction]) -> dict[str, Any]:
    outcomes = [claim.measure(run) for run in runs]
    several = len({outcome.ours for outcome in outcomes}) > 1
    ours = [
        f"seed {run.seed}: {outcome.ours}" if several else outcome.ours
        for run, outcome in zip(runs, outcomes, strict=True)
    ]
    agreeing = sum(outcome.agrees for outcome in outcomes)
    return {
        "claim": claim,
        "ours": ours if several else ours[:1],
        "agreeing": f"{agreeing} of {len(runs)}",
        "always": agreeing == len(runs),
    }


def _table_1(run: Reproduction) -> list[tuple[str, ...]]:
    right = {p.name: p for p in run.results[APPROPRIATE].parameters}
    dense = {p.name: p for p in run.results[INAPPROPRIATE].parameters}
    rows = []
    for name, (value, app, inap) in TABLE_1.items():
        ours, oversampled = right[name], dense[name]
        rows.append(
            (
                name,
                fixed(value, 2),
                number(ours.value, 3),
                f"{(ours.value - run.truth[name]) / ours.std:+.1f}",
                number(app, 2),
                number(100.0 * ours.white_std / abs(ours.value), 2),
                number(100.0 * ours.std / abs(ours.value), 2),
                number(inap, 2),
                number(100.0 * oversampled.white_std / abs(oversampled.value), 2),
                ours.unit,
            )
        )
    return rows


def _table_2(run: Reproduction) -> list[tuple[str, ...]]:
    refined = run.results[INAPPROPRIATE].refined
    assert refined is not None
    ours = {p.name: p for p in refined.parameters}
    return [
        (
            name,
            fixed(value, 2),
            number(ours[name].value, 3),
            number(percent, 3),
            number(100.0 * ours[name].std / abs(ours[name].value), 3),
            ours[name].unit,
        )
        for name, (value, percent) in TABLE_2.items()
    ]


def _table_3(run: Reproduction) -> list[tuple[str, ...]]:
    ours = {p.name: p for p in run.results[MODEL_ERROR].parameters}
    return [
        (
            name,
            fixed(run.truth[name], 2),
            fixed(value, 2),
            number(ours[name].value, 3),
            f"{(ours[name].value - run.truth[name]) / ours[name].std:+.1f}",
            number(percent, 3),
            number(100.0 * ours[name].std / abs(ours[name].value), 3),
            ours[name].unit,
        )
        for name, (value, percent) in TABLE_3.items()
    ]


def _figures(run: Reproduction) -> list[tuple[str, Figure, Figure]]:
    return [
        (
            f"{TITLES[name]}: figures {first} and {first + 1}",
            _acf(run.results[name], name),
            _histogram(_pooled(run.results[name]), name),
        )
        for name, first in _FIGURES
    ]


def _pooled(result: IdentificationResult) -> np.ndarray:
    """Residuals of all joints, each over its standard deviation."""
    return np.concatenate(
        [
            (series.measured - series.predicted) / np.std(series.measured - series.predicted)
            for series in result.series
        ]
    )


def _acf(result: IdentificationResult, name: str) -> Figure:
    data = [
        line(
            np.arange(len(residual.acf), dtype=float),
            residual.acf,
            BLUE,
            1.0,
            f"{residual.joint}: %{{y:.3f}}",
            mode="lines+markers",
            name=residual.joint,
            marker={"size": 4},
        )
        for residual in result.residuals
    ]
    for trace in data:
        del trace["line"]["color"]  # plotly's own: one for each joint
    bound = float(max(residual.acf_bound for residual in result.residuals))
    band = {
        "type": "rect",
        "xref": "paper",
        "x0": 0,
        "x1": 1,
        "y0": -bound,
        "y1": bound,
        "fillcolor": SHADE,
        "line": {"width": 0},
    }
    axes = {"xaxis": axis("Lag, rows"), "yaxis": axis("Autocorrelation", range=[-0.4, 1.05])}
    words = f"Autocorrelation of the residuals, {name}"
    look = {**axes, "shapes": [band], "showlegend": True}
    return Figure(f"acf-{name}", _HEIGHT, words, data, look)


def _histogram(residual: np.ndarray, name: str) -> Figure:
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
    gauss = np.exp(-0.5 * middle**2) / np.sqrt(2.0 * np.pi)
    gaussian = line(middle, gauss, ORANGE, 2.0, "Gaussian: %{y:.3f}", name="Gaussian")
    axes = {
        "xaxis": axis("Residual over its standard deviation, all joints"),
        "yaxis": axis("Density", zerolinecolor=INK),
    }
    look = {**axes, "bargap": 0.05, "showlegend": True}
    return Figure(f"histogram-{name}", _HEIGHT, f"Histogram, {name}", [bars, gaussian], look)
