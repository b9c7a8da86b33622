"""Periodic motions at rest where a period begins: finite Fourier series."""

from dataclasses import dataclass
from functools import cache

import numpy as np
import scipy

from idim_iv_ros.errors import UsageError
from idim_iv_ros.types import FloatArray

_BLOCK = 2000  # samples


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
        """Number of basis functions from which the motion of a joint is made."""
        return 2 * self.harmonics - 2

    def shapes(self, time: FloatArray) -> FloatArray:
        """Position, velocity and acceleration of the shapes, (3, n_samples, size)."""
        return self.motion(time, np.eye(self.size))

    def motion(self, time: FloatArray, coefficients: FloatArray) -> FloatArray:
        """Σ shape_i(t) c_i, (3, n_samples, n_joints), for `coefficients` (size, n_joints).

        Long motions have many harmonics: the shapes of all samples are never in memory at once.
        """
        sines, cosines = _at_rest(self.harmonics)
        odd_part = sines @ coefficients[: self.harmonics - 1]
        even_part = cosines @ coefficients[self.harmonics - 1 :]
        blocks = [
            [odd @ odd_part + even @ even_part for odd, even in self._waves(time[k : k + _BLOCK])]
            for k in range(0, len(time), _BLOCK)
        ]
        return np.concatenate(blocks, axis=1)

    def _waves(self, time: FloatArray) -> tuple[tuple[FloatArray, FloatArray], ...]:
        """Sine and cosine of each harmonic over its order, and two time derivatives."""
        order = np.arange(1, self.harmonics + 1)
        pulsation = 2.0 * np.pi / self.period * order
        sine, cosine = np.sin(time[:, None] * pulsation), np.cos(time[:, None] * pulsation)
        speed, rate = pulsation / order, pulsation**2 / order
        return (
            (sine / order, (cosine - 1.0) / order),
            (cosine * speed, -sine * speed),
            (-sine * rate, -cosine * rate),
        )


@cache
def _at_rest(harmonics: int) -> tuple[FloatArray, FloatArray]:
    """Coefficients of the sines without velocity, of the cosines without acceleration, at t = 0."""
    order = np.arange(1.0, harmonics + 1.0)
    return scipy.linalg.null_space(np.ones((1, harmonics))), scipy.linalg.null_space(order[None, :])
