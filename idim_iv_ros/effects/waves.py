"""Sums of waves over a joint's position, for ripple and for friction that depends on position."""

import numpy as np

from idim_iv_ros.diagnosis.result import EffectParameter
from idim_iv_ros.effects.effect import OperatingRange, Place, Shape, number
from idim_iv_ros.types import FloatArray

MOST_WAVES = 3
_FINEST = 3.0  # steps of the grid in one period of resolution, 2π / range
_MOST = 400
_HIGHEST = 250.0  # 1/rad: finer than the teeth of a gear; 2500 1/m: than the pitch of a screw


def wave_numbers(place: Place, covered: OperatingRange, periods: float) -> FloatArray:
    """Wave numbers 1/rad (1/m) from that many periods in the range of the joint on.

    The finest is what the slowest motion that counts shows below the rows' Nyquist frequency.
    """
    span = float(covered.high[place.joint] - covered.low[place.joint])
    if span <= 0.0:
        return np.zeros(0)
    low = periods * 2.0 * np.pi / span
    visible = np.pi * covered.row_rate / max(3.0 * covered.slowest[place.joint], 1e-6)
    high = min(_HIGHEST / float(covered.lever[place.joint]), max(visible, low))
    step = max(2.0 * np.pi / span / _FINEST, (high - low) / _MOST)
    return np.asarray(np.arange(low, high, step))


def waves(position: FloatArray, numbers: Shape) -> FloatArray:
    """Sine and cosine of each wave number, (s, 2 k)."""
    phase = np.outer(position, numbers)
    both = np.empty((len(position), 2 * len(numbers)))
    np.sin(phase, out=both[:, ::2])
    np.cos(phase, out=both[:, 1::2])
    return both


def near_waves(shape: Shape, step: float, span: float) -> list[Shape]:
    """Each wave number a little higher and lower, by a share of the resolution 2π / span."""
    move = step * 2.0 * np.pi / span
    return [
        (*shape[:k], max(shape[k] + sign * move, 1e-3), *shape[k + 1 :])
        for k in range(len(shape))
        for sign in (1.0, -1.0)
    ]


def wave_parameters(
    shape: Shape, coefficients: FloatArray, deviations: FloatArray
) -> dict[str, EffectParameter]:
    """wave_number_k, sine_k, cosine_k."""
    found: dict[str, EffectParameter] = {}
    for k, wave_number in enumerate(shape):
        found[f"wave_number_{k + 1}"] = number(wave_number, None, "1/rad")
        for part, name in enumerate(("sine", "cosine")):
            i = 2 * k + part
            found[f"{name}_{k + 1}"] = number(coefficients[i], deviations[i], "N m")
    return found
