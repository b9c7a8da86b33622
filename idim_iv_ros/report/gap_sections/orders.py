"""The order spectrum: what the torque does at each wave number of the position."""

from typing import Any

import numpy as np

from idim_iv_ros.diagnosis.result import GapResult, GapSeries
from idim_iv_ros.report.figures import BLUE, INK, ORANGE, Figure, axis, embed, figure, legend, typed
from idim_iv_ros.report.gap_words import (
    drawable,
    extended_beyond_refit,
    prismatic,
    rms,
    torque_unit,
)
from idim_iv_ros.report.markup import Html, section, tag
from idim_iv_ros.report.numerals import number, round_number
from idim_iv_ros.report.order_spectrum import OrderSpectrum, order_spectrum
from idim_iv_ros.types import FloatArray

_HEIGHT = 230
_STANDS_OUT = 6.0  # times the median
_LEAST_RANGE = 0.4  # of the residual's rms: the spectrum of noise must not look like peaks


def orders_section(result: GapResult) -> Html | None:
    """Return one spectrum for each joint that moves, or None."""
    plots = [_joint(result, series, index) for index, series in enumerate(drawable(result))]
    shown = [each for each in plots if each is not None]
    if not shown:
        return None
    extended = any(extended_beyond_refit(series) for series in drawable(result))
    return section(
        "Order spectrum",
        "orders",
        tag(
            "p",
            "Amplitude of the wave sin(k q + φ) that fits the residual best, over its wave "
            "number k in 1/rad, which is the number of periods per turn of the joint. A narrow "
            "peak is a ripple that is fixed to the position (cogging, gears, encoder); its k is "
            "a multiple of the gear ratio where the motor causes it.",
            css="explanation",
        ),
        legend(
            ("line", ORANGE, "refit"), *([("line", BLUE, "extended model")] if extended else [])
        ),
        tag("div", shown, css="grid one" if len(shown) == 1 else "grid two"),
    )


def _joint(result: GapResult, series: GapSeries, index: int) -> Html | None:
    models = [series.refit, series.extended] if extended_beyond_refit(series) else [series.refit]
    residuals = [series.torque - values for values in models]
    spectrum = order_spectrum(series.position, series.speed, residuals, series.step)
    if spectrum is None:
        return None
    unit = torque_unit(result, series.joint)
    least = _LEAST_RANGE * rms(residuals[0])
    drawing = _drawing(spectrum, unit, prismatic(result, series.joint), least)
    words = f"Amplitude of the residual of {series.joint} over the wave number of its position"
    return tag(
        "div",
        tag("h3", series.joint),
        embed(drawing, f"orders-{index}", _HEIGHT, words),
        css="plot",
    )


def _drawing(spectrum: OrderSpectrum, unit: str, along: bool, least: float) -> Figure:
    wave = spectrum.wave_number
    title = "Wave number, 1/m (÷ 2π: periods per metre)" if along else "Wave number, 1/rad = 1/turn"
    # Without effects at this joint there is no extended model to draw.
    lines = zip(spectrum.amplitudes, (ORANGE, BLUE), ("refit", "extended"), strict=False)
    data: list[dict[str, Any]] = [
        {
            "type": "scatter",
            "mode": "lines",
            "x": typed(wave),
            "y": typed(amplitude),
            "line": {"color": colour, "width": 1.3},
            "hovertemplate": f"{name}: %{{y:.3g}} {unit} at %{{x:.4g}}<extra></extra>",
        }
        for amplitude, colour, name in lines
    ]
    highest = max(float(amplitude.max()) for amplitude in spectrum.amplitudes)
    axes = {
        "xaxis": axis(title, type="log", range=list(np.log10([wave[0], wave[-1]])), **_ticks(wave)),
        "yaxis": axis(f"Amplitude, {unit}", range=[0.0, max(least, 1.08 * highest)], nticks=5),
    }
    return figure(data, axes, annotations=_peak(spectrum, unit), hovermode="closest")


def _ticks(wave: FloatArray) -> dict[str, list[Any]]:
    powers = range(int(np.floor(np.log10(wave[0]))), int(np.ceil(np.log10(wave[-1]))) + 1)
    values = [factor * 10.0**power for power in powers for factor in (1.0, 2.0, 5.0)]
    inside = [value for value in values if wave[0] <= value <= wave[-1]]
    return {"tickvals": inside, "ticktext": [round_number(value) for value in inside]}


def _peak(spectrum: OrderSpectrum, unit: str) -> list[dict[str, Any]]:
    """The largest wave of the refit residual, named if it stands out."""
    amplitude = spectrum.amplitudes[0]
    place = int(np.argmax(amplitude))
    if amplitude[place] < _STANDS_OUT * float(np.median(amplitude)):
        return []
    wave = float(spectrum.wave_number[place])
    return [
        {
            "x": float(np.log10(wave)),
            "y": float(amplitude[place]),
            "text": f"k = {number(wave, 3)}: {number(float(amplitude[place]), 2)} {unit}",
            "showarrow": False,
            "xanchor": "right" if place > 0.4 * len(amplitude) else "left",
            "xshift": -6 if place > 0.4 * len(amplitude) else 6,
            "yanchor": "middle",
            "font": {"size": 11, "color": INK},
        }
    ]
