"""Sections on validation: is the residual noise, and are the instruments valid?"""

from typing import Any

import numpy as np

from idim_iv_ros.identification.result import IdentificationResult, JointResidual
from idim_iv_ros.report.figures import (
    BLUE,
    INK,
    ORANGE,
    Figure,
    axis,
    band,
    line,
)
from idim_iv_ros.types import FloatArray

_HEIGHT = 230


def autocorrelation_figure(result: IdentificationResult, residual: JointResidual) -> Figure:
    """Return a figure of the autocorrelation of a joint's residual, with its whitened part."""
    rate = result.processing.row_rate
    data = [_stems(residual.acf, ORANGE, "residual", -0.14, rate)]
    if residual.ar_order > 0:
        data.append(_stems(residual.acf_whitened, BLUE, "whitened", 0.14, rate))
    bound = float(residual.acf_bound)
    everything = np.concatenate([residual.acf[1:], residual.acf_whitened[1:], [-bound]])
    white = band((0, 1), (-bound, bound), xref="paper")
    ends = [1.15 * min(float(np.nanmin(everything)), -0.08), 1.04]
    axes = {
        "xaxis": axis("Lag, samples", range=[-0.6, len(residual.acf) - 0.4], showgrid=False),
        "yaxis": axis("Autocorrelation", range=ends, zeroline=True, zerolinecolor=INK),
    }
    words = f"Autocorrelation of the residual of {residual.joint}"
    anchor = f"acf-{result.joints.index(residual.joint)}"
    return Figure(anchor, _HEIGHT, words, data, {**axes, "shapes": [white]})


def _stems(
    correlation: FloatArray, colour: str, name: str, offset: float, rate: float
) -> dict[str, Any]:
    """Return a trace of vertical lines with dots, one for each lag; `rate` in Hz."""
    lags = np.arange(len(correlation))
    height = np.nan_to_num(np.asarray(correlation, dtype=float))
    apart = np.full(len(lags), np.nan)
    x = np.column_stack([lags + offset, lags + offset, apart]).ravel()
    y = np.column_stack([np.zeros(len(lags)), height, apart]).ravel()
    size = np.tile([0.0, 4.0, 0.0], len(lags))
    lag_times = [f"{lag} samples ({1000.0 * lag / rate:.4g} ms)" for lag in lags]
    text = [words for lag_time in lag_times for words in ("", lag_time, "")]
    marker = {"color": colour, "size": size.tolist(), "line": {"width": 0}}
    hover = f"{name}: %{{y:.3f}} at %{{text}}"
    return line(x, y, colour, 1.5, hover, "lines+markers", text=text, marker=marker)
