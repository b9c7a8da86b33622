"""Is what is left noise, and are the instruments valid? The tests, their figures and words."""

from typing import Any

import numpy as np

from idim_iv_ros.identification.result import IdentificationResult, JointResidual
from idim_iv_ros.report.figures import (
    BLUE,
    INK,
    ORANGE,
    SHADE,
    Figure,
    Mark,
    axis,
    band,
    layout,
    line,
    typed,
)
from idim_iv_ros.report.numerals import count, number, p_value
from idim_iv_ros.report.section import Report, Section
from idim_iv_ros.report.time_axis import contiguous_rows
from idim_iv_ros.statistics import HypothesisTest
from idim_iv_ros.types import FloatArray

_HEIGHT = 230
_SPACE = "\N{NO-BREAK SPACE}"
_BINS = 41
_WIDEST = 5.0  # σ; further samples are counted in the outermost bins

# An answer and what it rests on.
Answer = tuple[str, str]


def _context(report: Report[IdentificationResult]) -> dict[str, Any]:
    return {
        "answers": (_white, _whitened, _gaussian),
        "legend": [
            Mark("line", ORANGE, "residual as it is"),
            Mark("bar", BLUE, "whitened by the autoregressive filter"),
            Mark("band", SHADE, "95 % of a white residual's correlations"),
            Mark("line", INK, "Gaussian"),
        ],
        "plots": [_plots(report, index) for index in range(len(report.result.residuals))],
    }


def _white(residual: JointResidual) -> Answer:
    test = residual.whiteness
    if residual.white is None:
        return "not tested", test.reason or ""
    if not residual.white:
        return "no", _p(test)
    return ("yes" if test.accepted else "yes, its autocorrelation is harmless"), _p(test)


def _whitened(residual: JointResidual) -> Answer:
    test = residual.whiteness_after
    if residual.ar_order == 0:
        return "nothing to filter", ""
    if test.accepted is None:
        return "not tested", test.reason or ""
    if test.accepted:
        return "yes", _p(test)
    left = number(residual.largest_correlation_after, 2)
    return "not fully", f"{_p(test)}, largest correlation {left}"


def _gaussian(residual: JointResidual) -> Answer:
    test = residual.normality
    if test.accepted is None:
        return "not tested", test.reason or ""
    skewness, kurtosis = residual.skewness, residual.excess_kurtosis
    shape = f"skewness {number(skewness, 2)}, excess kurtosis {number(kurtosis, 2)}"
    if test.accepted:
        return "yes", f"{_p(test)}; {shape}"
    near = abs(skewness) < 0.5 and abs(kurtosis) < 1.0
    return ("nearly" if near else "no"), f"{_p(test)}; {shape}"


def _p(test: HypothesisTest) -> str:
    text = p_value(test.p_value)
    return f"p{_SPACE}{text}" if text.startswith("<") else f"p{_SPACE}={_SPACE}{text}"


def _plots(report: Report[IdentificationResult], index: int) -> tuple[str, str, Figure, Figure]:
    result = report.result
    residual, series = result.residuals[index], result.series[index]
    raw = np.asarray(series.measured) - np.asarray(series.predicted)
    pieces = contiguous_rows(series, report.session)
    whitening = residual.autoregression
    whitened = whitening.whiten(raw, pieces) if whitening is not None and pieces else raw
    if residual.white is None:
        state = "autocorrelation not tested"
    elif residual.white:
        state = "may be treated as white"
    else:
        state = f"autocorrelated, AR({residual.ar_order})"
    return (
        residual.joint,
        state,
        _acf(residual, result.processing.row_rate, index),
        _histogram(raw, whitened, residual.joint, index),
    )


def _acf(residual: JointResidual, rate: float, index: int) -> Figure:
    """Autocorrelation before and after whitening, with the bounds of white noise."""
    data = [_stems(residual.acf, ORANGE, "residual", -0.14, rate)]
    if residual.ar_order > 0:
        data.append(_stems(residual.acf_whitened, BLUE, "whitened", 0.14, rate))
    bound = float(residual.acf_bound)
    everything = np.concatenate([residual.acf[1:], residual.acf_whitened[1:], [-bound]])
    white = band((0, 1), (-bound, bound), xref="paper")
    axes = {
        "xaxis": axis("Lag, samples", range=[-0.6, len(residual.acf) - 0.4], showgrid=False),
        "yaxis": axis(
            "Autocorrelation",
            range=[1.15 * min(float(np.nanmin(everything)), -0.08), 1.04],
            zeroline=True,
            zerolinecolor=INK,
        ),
    }
    words = f"Autocorrelation of the residual of {residual.joint}"
    return Figure(f"acf-{index}", _HEIGHT, words, data, layout(axes, shapes=[white]))


def _stems(
    correlation: FloatArray, colour: str, name: str, offset: float, rate: float
) -> dict[str, Any]:
    """Return vertical lines with a dot, one trace."""
    lags = np.arange(len(correlation))
    height = np.nan_to_num(np.asarray(correlation, dtype=float))
    apart = np.full(len(lags), np.nan)
    x = np.column_stack([lags + offset, lags + offset, apart]).ravel()
    y = np.column_stack([np.zeros(len(lags)), height, apart]).ravel()
    size = np.tile([0.0, 4.0, 0.0], len(lags))
    lag_times = [f"{lag} samples ({1000.0 * lag / rate:.4g} ms)" for lag in lags]
    return line(
        x,
        y,
        colour,
        1.5,
        f"{name}: %{{y:.3f}} at %{{text}}",
        mode="lines+markers",
        text=[words for lag_time in lag_times for words in ("", lag_time, "")],
        marker={"color": colour, "size": size.tolist(), "line": {"width": 0}},
    )


def _histogram(raw: FloatArray, whitened: FloatArray, joint: str, index: int) -> Figure:
    """Histograms of the residual and the whitened residual, each in its own σ."""
    edges = np.linspace(-_WIDEST, _WIDEST, _BINS + 1)
    centres = 0.5 * (edges[1:] + edges[:-1])
    grid = np.linspace(-_WIDEST, _WIDEST, 161)
    gauss = np.exp(-0.5 * grid**2) / np.sqrt(2.0 * np.pi)
    bars = {
        "type": "bar",
        "x": typed(centres),
        "y": typed(_density(whitened, edges)),
        "width": float(edges[1] - edges[0]),
        "marker": {"color": BLUE, "opacity": 0.55, "line": {"width": 0}},
        "hovertemplate": "whitened: density %{y:.3f} at %{x:.2f} σ<extra></extra>",
    }
    hover = "residual: density %{y:.3f} at %{x:.2f} σ"
    data = [
        bars,
        line(centres, _density(raw, edges), ORANGE, 1.5, hover),
        line(grid, gauss, INK, 1.5, "", hoverinfo="skip"),
    ]
    axes = {
        "xaxis": axis("Residual, in its standard deviation σ", range=[-5.2, 5.2], dtick=1),
        "yaxis": axis("Density, 1/σ", rangemode="tozero", nticks=5),
    }
    words = f"Histogram of the residual of {joint} with a Gaussian"
    return Figure(f"histogram-{index}", _HEIGHT, words, data, layout(axes, bargap=0))


def _density(values: FloatArray, edges: FloatArray) -> FloatArray:
    spread = float(np.std(values)) if len(values) else 0.0
    if spread == 0.0:
        return np.zeros(len(edges) - 1)
    unit = np.clip((values - np.mean(values)) / spread, edges[0], edges[-1])
    counts, _ = np.histogram(unit, bins=edges)
    return counts / (len(values) * np.diff(edges))


RESIDUALS = Section(
    "Residuals",
    "residuals",
    "residuals.html.j2",
    _context,
    "whether what is left is noise: autocorrelation, normality, refined deviations",
)


def _statistic(test: HypothesisTest) -> str:
    """Return statistic with its distribution under the null hypothesis."""
    df = count(test.df or 0)
    law = f"χ²({df})" if test.df_denom is None else f"F({df}, {count(test.df_denom)})"
    return f"{law} = {number(test.statistic, 3)}"


def _badge(accepted: bool | None, neutral: bool) -> tuple[str, str, str]:
    """Badge of a test; `neutral` where neither outcome is bad news."""
    if accepted is None:
        return "open", "–", "not tested"
    words = "accepted" if accepted else "rejected"
    if neutral:
        return "fair", "=" if accepted else "≠", words
    return ("good", "✓", words) if accepted else ("bad", "✕", words)


INSTRUMENTS = Section(
    "Tests",
    "instruments",
    "instruments.html.j2",
    lambda report: {"badge_of": _badge, "statistic": _statistic},
    "Durbin-Wu-Hausman: whether the instruments are valid and least squares biased",
)
