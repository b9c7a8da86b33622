"""The order spectrum: what the torque does at each wave number of the position."""

from typing import Any

import numpy as np

from idim_iv_ros.diagnosis.result import GapResult, GapSeries
from idim_iv_ros.report.figures import BLUE, INK, ORANGE, Figure, Mark, axis, layout, line
from idim_iv_ros.report.gap_words import drawable, extended_beyond_refit, torque_unit, unit_in
from idim_iv_ros.report.numerals import number, round_number
from idim_iv_ros.report.section import Report, Section
from idim_iv_ros.statistics.curves import OrderSpectrum, order_spectrum
from idim_iv_ros.types import FloatArray

_HEIGHT = 230
_STANDS_OUT = 6.0  # times the median
_LEAST_RANGE = 0.4  # of the residual's rms: the spectrum of noise must not look like peaks


def _context(report: Report[GapResult]) -> dict[str, Any] | None:
    result = report.result
    figures = [
        (each.joint, _figure(result, each, index)) for index, each in enumerate(drawable(result))
    ]
    plots = [(joint, figure) for joint, figure in figures if figure is not None]
    if not plots:
        return None
    marks = [Mark("line", ORANGE, "refit")]
    if any(extended_beyond_refit(series) for series in drawable(result)):
        marks.append(Mark("line", BLUE, "extended model"))
    return {"plots": plots, "legend": marks, "columns": "one" if len(plots) == 1 else "two"}


def _figure(result: GapResult, series: GapSeries, index: int) -> Figure | None:
    models = [series.refit, series.extended] if extended_beyond_refit(series) else [series.refit]
    residuals = [series.torque - values for values in models]
    spectrum = order_spectrum(series.position, series.speed, residuals, series.step)
    if spectrum is None:
        return None
    unit = torque_unit(result, series.joint)
    wave = spectrum.wave_number
    slides = unit_in(result, "rad", series.joint) == "m"
    title = (
        "Wave number, 1/m (÷ 2π: periods per metre)" if slides else "Wave number, 1/rad = 1/turn"
    )
    # Without effects at this joint there is no extended model to draw.
    drawn = zip(spectrum.amplitudes, (ORANGE, BLUE), ("refit", "extended"), strict=False)
    data = [
        line(
            {"same": 0} if place else wave,
            amplitude,
            colour,
            1.3,
            f"{name}: %{{y:.3g}} {unit} at %{{x:.4g}}",
        )
        for place, (amplitude, colour, name) in enumerate(drawn)
    ]
    highest = max(float(amplitude.max()) for amplitude in spectrum.amplitudes)
    finite = residuals[0][np.isfinite(residuals[0])]
    least = _LEAST_RANGE * float(np.sqrt(np.mean(finite**2)))
    axes = {
        "xaxis": axis(title, type="log", range=list(np.log10([wave[0], wave[-1]])), **_ticks(wave)),
        "yaxis": axis(f"Amplitude, {unit}", range=[0.0, max(least, 1.08 * highest)], nticks=5),
    }
    words = f"Amplitude of the residual of {series.joint} over the wave number of its position"
    look = layout(axes, annotations=_peak(spectrum, unit))
    return Figure(f"orders-{index}", _HEIGHT, words, data, look)


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
    left = place > 0.4 * len(amplitude)
    return [
        {
            "x": float(np.log10(wave)),
            "y": float(amplitude[place]),
            "text": f"k = {number(wave, 3)}: {number(float(amplitude[place]), 2)} {unit}",
            "showarrow": False,
            "xanchor": "right" if left else "left",
            "xshift": -6 if left else 6,
            "yanchor": "middle",
            "font": {"size": 11, "color": INK},
        }
    ]


ORDERS = Section(
    "Orders", "orders", "orders.html.j2", _context, "what repeats with every turn of a joint"
)
