"""Autocorrelation and histogram of one residual (figures 1 to 6 of the paper)."""

from typing import Any

import numpy as np

from idim_iv_ros.identification.result import JointResidual
from idim_iv_ros.report.figures import BLUE, INK, ORANGE, SHADE, Figure, axis, figure, typed
from idim_iv_ros.types import FloatArray

_BINS = 41
_WIDEST = 5.0  # σ; further samples are counted in the outermost bins


def acf_figure(residual: JointResidual, rate: float) -> Figure:
    """Return the autocorrelation before and after whitening, with the bounds of white noise.

    Parameters
    ----------
    rate : float
        Rows per second, Hz.
    """
    data = [_stems(residual.acf, ORANGE, "residual", -0.14, rate)]
    if residual.ar_order > 0:
        data.append(_stems(residual.acf_whitened, BLUE, "whitened", 0.14, rate))
    bound = float(residual.acf_bound)
    everything = np.concatenate([residual.acf[1:], residual.acf_whitened[1:], [-bound]])
    band = {
        "type": "rect",
        "xref": "paper",
        "x0": 0,
        "x1": 1,
        "y0": -bound,
        "y1": bound,
        "fillcolor": SHADE,
        "line": {"width": 0},
        "layer": "below",
    }
    axes = {
        "xaxis": axis("Lag, samples", range=[-0.6, len(residual.acf) - 0.4], showgrid=False),
        "yaxis": axis(
            "Autocorrelation",
            range=[1.15 * min(float(np.nanmin(everything)), -0.08), 1.04],
            zeroline=True,
            zerolinecolor=INK,
        ),
    }
    return figure(data, axes, shapes=[band])


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
    text = [words for each in lag_times for words in ("", each, "")]
    return {
        "type": "scatter",
        "mode": "lines+markers",
        "x": typed(x),
        "y": typed(y),
        "text": text,
        "line": {"color": colour, "width": 1.5},
        "marker": {"color": colour, "size": size.tolist(), "line": {"width": 0}},
        "hovertemplate": f"{name}: %{{y:.3f}} at %{{text}}<extra></extra>",
    }


def histogram_figure(raw: FloatArray, whitened: FloatArray) -> Figure:
    """Return histograms of the residual and the whitened residual, each in its own σ.

    Parameters
    ----------
    raw, whitened : (r,)
        Residual of the rows that count.
    """
    edges = np.linspace(-_WIDEST, _WIDEST, _BINS + 1)
    centres = 0.5 * (edges[1:] + edges[:-1])
    grid = np.linspace(-_WIDEST, _WIDEST, 161)
    gauss = np.exp(-0.5 * grid**2) / np.sqrt(2.0 * np.pi)
    data: list[dict[str, Any]] = [
        {
            "type": "bar",
            "x": typed(centres),
            "y": typed(_density(whitened, edges)),
            "width": float(edges[1] - edges[0]),
            "marker": {"color": BLUE, "opacity": 0.55, "line": {"width": 0}},
            "hovertemplate": "whitened: density %{y:.3f} at %{x:.2f} σ<extra></extra>",
        },
        {
            "type": "scatter",
            "mode": "lines",
            "x": typed(centres),
            "y": typed(_density(raw, edges)),
            "line": {"color": ORANGE, "width": 1.5, "shape": "hvh"},
            "hovertemplate": "residual: density %{y:.3f} at %{x:.2f} σ<extra></extra>",
        },
        {
            "type": "scatter",
            "mode": "lines",
            "x": typed(grid),
            "y": typed(gauss),
            "line": {"color": INK, "width": 1.5},
            "hoverinfo": "skip",
        },
    ]
    axes = {
        "xaxis": axis("Residual, in its standard deviation σ", range=[-5.2, 5.2], dtick=1),
        "yaxis": axis("Density, 1/σ", rangemode="tozero", nticks=5),
    }
    return figure(data, axes, bargap=0)


def _density(values: FloatArray, edges: FloatArray) -> FloatArray:
    spread = float(np.std(values)) if len(values) else 0.0
    if spread == 0.0:
        return np.zeros(len(edges) - 1)
    unit = np.clip((values - np.mean(values)) / spread, edges[0], edges[-1])
    counts, _ = np.histogram(unit, bins=edges)
    return counts / (len(values) * np.diff(edges))
