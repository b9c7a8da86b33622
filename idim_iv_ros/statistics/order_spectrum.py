"""Amplitude of a residual over the wave number of the position: ripple shows as a peak."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from idim_iv_ros.types import FloatArray

_MOST_WAVES = 300  # over the range of the motion
_PER_WAVE = 3  # points of the spectrum
_CELLS_PER_WAVE = 8
_CHUNK = 100


@dataclass(frozen=True)
class OrderSpectrum:
    """Amplitudes of sin and cos (k q) that fit each residual.

    Attributes
    ----------
    wave_number : (n,)
        k in 1/rad, which is periods per turn (2πk in 1/m periods per metre).
    amplitudes : tuple of (n,)
        One for each residual, in its unit.
    """

    wave_number: FloatArray
    amplitudes: tuple[FloatArray, ...]


def order_spectrum(
    position: FloatArray, speed: FloatArray, residuals: Sequence[FloatArray], step: float
) -> OrderSpectrum | None:
    """Fit a wave of each wave number to residuals, by least squares.

    What is constant in each direction or linear in the position goes first. The largest wave
    number is one that moves by 0.8 of half a period between rows at a slow pace (the 30th
    percentile of the speed): the torque of faster waves is filtered away.

    Returns
    -------
    OrderSpectrum or None
        None where the joint hardly moves.

    Parameters
    ----------
    position, speed : (r,)
    residuals : (r,) each
    step : s
    """
    sound = np.isfinite(position) & np.isfinite(speed)
    for residual in residuals:
        sound &= np.isfinite(residual)
    position, speed = position[sound], speed[sound]
    residuals = [residual[sound] for residual in residuals]
    span = float(np.ptp(position)) if len(position) else 0.0
    pace = float(np.percentile(np.abs(speed), 30)) if len(speed) else 0.0
    if span == 0.0 or pace == 0.0:
        return None
    lowest = 2.0 * np.pi / span
    highest = min(0.8 * np.pi / (step * pace), _MOST_WAVES * lowest)
    if highest < 4.0 * lowest:
        return None
    wave = np.arange(lowest, highest, lowest / _PER_WAVE)
    cells = int(_CELLS_PER_WAVE * highest / lowest)
    cell = np.minimum((position - position.min()) / span * cells, cells - 1).astype(np.int64)
    trend = np.column_stack([np.ones(len(position)), position, np.sign(speed)])
    columns = [np.bincount(cell, minlength=cells).astype(float)]
    for residual in residuals:
        rest = residual - trend @ np.linalg.lstsq(trend, residual, rcond=None)[0]
        columns.append(np.bincount(cell, weights=rest, minlength=cells))
    centre = position.min() + (np.arange(cells) + 0.5) / cells * span
    amplitudes = _amplitudes(wave, centre, np.column_stack(columns))
    return OrderSpectrum(wave, tuple(amplitudes))


def _amplitudes(wave: FloatArray, place: FloatArray, sums: FloatArray) -> FloatArray:
    """Amplitudes, (residuals, wave numbers), of sums over cells; the first column counts rows."""
    amplitudes = np.zeros((sums.shape[1] - 1, len(wave)))
    rows = sums[:, 0].sum()
    for first in range(0, len(wave), _CHUNK):
        chunk = slice(first, first + _CHUNK)
        turn = np.exp(1j * np.outer(wave[chunk], place))
        right = turn @ sums[:, 1:]
        double = turn**2 @ sums[:, 0]
        # Normal equations of a cos + b sin: [[N + C, S], [S, N − C]] / 2.
        c, s = double.real[:, None], double.imag[:, None]
        determinant = np.maximum(rows**2 - c**2 - s**2, 1e-9 * rows**2)
        a = 2.0 * ((rows - c) * right.real - s * right.imag) / determinant
        b = 2.0 * ((rows + c) * right.imag - s * right.real) / determinant
        amplitudes[:, chunk] = np.hypot(a, b).T
    return amplitudes
