"""Periodic motions at rest where a period begins: finite Fourier series."""

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from idim_iv_ros.errors import UsageError

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class FourierBasis:
    """Shapes of a motion: q(t) = start + Σ shape_i(t) c_i, with q(0) = start.

    Every shape is a sum of sin(kωt)/k and cos(kωt)/k, k = 1 … harmonics, ω = 2π / period, whose
    velocity and acceleration are zero at t = 0 (and so at every multiple of the period): two
    linear constraints on the 2 · harmonics coefficients, solved once by their null space.

    Source: Swevers, Ganseman, Tükel, De Schutter, Van Brussel, Optimal robot excitation and
    identification, IEEE Trans. Robotics and Automation 13 (1997), equation 10.
    """

    period: float
    harmonics: int

    def __post_init__(self) -> None:
        if not (np.isfinite(self.period) and self.period > 0.0):
            raise UsageError(f"period {self.period:g}: seconds above 0 are needed")
        if self.harmonics < 2:
            raise UsageError("harmonics: at least 2 are needed for a motion that starts at rest")

    @property
    def size(self) -> int:
        """Number of shapes of each joint."""
        return 2 * self.harmonics - 2

    def shapes(self, time: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Position, velocity and acceleration of the shapes: three of (n_samples, size)."""
        order = np.arange(1, self.harmonics + 1)
        pulsation = 2.0 * np.pi / self.period * order
        sine, cosine = np.sin(time[:, None] * pulsation), np.cos(time[:, None] * pulsation)
        sines = scipy.linalg.null_space(np.ones((1, self.harmonics)))
        cosines = scipy.linalg.null_space(order[None, :].astype(float))
        position = np.hstack([(sine / order) @ sines, ((cosine - 1.0) / order) @ cosines])
        speed = pulsation / order
        velocity = np.hstack([(cosine * speed) @ sines, (-sine * speed) @ cosines])
        rate = pulsation**2 / order
        acceleration = np.hstack([(-sine * rate) @ sines, (-cosine * rate) @ cosines])
        return position, velocity, acceleration
