"""Pre-sliding: dry friction that builds up over a small displacement after a reversal."""

import numpy as np
from numba import njit

from idim_iv_ros.diagnosis.refit.smooth_motion import SmoothMotion
from idim_iv_ros.diagnosis.result import EffectParameter
from idim_iv_ros.effects.effect import (
    Effect,
    OperatingRange,
    Place,
    Shape,
    ShareOf,
    logarithmic,
    number,
)
from idim_iv_ros.types import FloatArray

_MOST = 3


@njit(cache=True)
def bristle(position: FloatArray, span: float) -> FloatArray:
    """Deflection (s,) of a Maxwell-slip element, −1 to 1, at rest at the start."""
    deflection = np.zeros(len(position))
    for k in range(1, len(position)):
        value = deflection[k - 1] + (position[k] - position[k - 1]) / span
        deflection[k] = min(max(value, -1.0), 1.0)
    return deflection


class Presliding(Effect):
    """Σ level_k (z_k − sign(dq)), z_k a bristle that slips after span_k; shape: the spans.

    Replaces as much of the Coulomb friction by springs that slip (Maxwell-slip).

    Simulated by `simulation.effect_kernel.effect_torques` and
    `simulation.effect_kernel.slide_bristles`.
    """

    name = "presliding"
    order = 70
    family = "velocity"
    confounders = ("stribeck", "backlash")
    excitation = "many small reversals of different sizes, at different rates"
    typical = ShareOf("dry friction", 0.5)

    def grid(self, place: Place, covered: OperatingRange) -> list[Shape]:
        """Spans from 0.1 mrad (10 µm) to a tenth of the range."""
        span = float(covered.high[place.joint] - covered.low[place.joint])
        if span <= 0.0:
            return []
        least = 1e-4 * float(covered.lever[place.joint])
        return [(float(s),) for s in logarithmic(least, max(0.15 * span, 10.0 * least), 16)]

    def longer(self, shape: Shape, place: Place, covered: OperatingRange) -> list[Shape]:
        """One more bristle."""
        if len(shape) >= _MOST:
            return []
        return [(*shape, *other) for other in self.grid(place, covered)]

    def cannot_show(self, joint: int, covered: OperatingRange) -> str:
        """It needs to be known where joints stick."""
        if covered.sticking:
            return ""
        return "where joints stick is not known, for the closed loop is not simulated"

    def columns(self, motion: SmoothMotion, place: Place, shape: Shape) -> dict[int, FloatArray]:
        """See the class."""
        q = np.ascontiguousarray(motion.position[:, place.joint])
        sign = motion.slip[:, place.joint]
        return {place.joint: np.column_stack([bristle(q, span) - sign for span in shape])}

    def admissible(self, shape: Shape, coefficients: FloatArray) -> bool:
        """All bristles are springs."""
        return bool(np.all(coefficients >= 0.0))

    def parameters(
        self, shape: Shape, coefficients: FloatArray, deviations: FloatArray
    ) -> dict[str, EffectParameter]:
        """Spans and levels."""
        found: dict[str, EffectParameter] = {}
        for k, span in enumerate(shape):
            found[f"span_{k + 1}"] = number(span, None, "rad")
            found[f"level_{k + 1}"] = number(coefficients[k], deviations[k], "N m")
        return found
