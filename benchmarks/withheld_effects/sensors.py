"""Noise, counts and gaps of what is recorded."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

FloatArray = NDArray[np.float64]
DROPOUT_RATE = 0.7  # 1/s


@dataclass(frozen=True)
class Sensors:
    """Noise of the recording; arrays (n_joints,).

    Attributes
    ----------
    position : rad, white, before the encoder counts
    velocity : rad/s, white
    torque : N m, standard deviation
    resolution : rad, one count of the encoder
    colour : float
        Pole of the torque noise at the control period; 0: white.
    jitter : float
        s, standard deviation of the time stamps; the samples themselves are even.
    dropout : s, mean duration for which the recorded effort freezes, DROPOUT_RATE times a second
    """

    position: FloatArray
    velocity: FloatArray
    torque: FloatArray
    resolution: FloatArray
    colour: float
    jitter: float
    dropout: FloatArray


def coloured(white: FloatArray, pole: float) -> FloatArray:
    """First-order noise of the same standard deviation."""
    if pole == 0.0:
        return white
    return np.asarray(lfilter([np.sqrt(1.0 - pole**2)], [1.0, -pole], white, axis=0))


def frozen(
    effort: FloatArray, mean: FloatArray, period: float, chance: np.random.Generator
) -> FloatArray:
    """Hold the last value for 0.5 to 1.5 of the mean duration (n_joints,) s at random times."""
    stuck = effort.copy()
    for j in np.flatnonzero(mean > 0.0):
        times = max(2, chance.poisson(DROPOUT_RATE * len(effort) * period))
        for start in chance.integers(1, len(effort), times):
            length = round(mean[j] * chance.uniform(0.5, 1.5) / period)
            stuck[start : start + length, j] = stuck[start - 1, j]
    return stuck
