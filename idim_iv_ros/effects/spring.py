"""A spring on the joint: a gravity compensator, a cable, a hose."""

import numpy as np

from idim_iv_ros.diagnosis.refit.smooth_motion import SmoothMotion
from idim_iv_ros.diagnosis.result import EffectParameter
from idim_iv_ros.effects.effect import Effect, OperatingRange, Place, Shape, ShareOf, number
from idim_iv_ros.types import FloatArray

_CUBIC, _HARDENING, _SOFTENING = 0.0, 1.0, 2.0
_CENTRES = 9
_WIDTHS = (0.1, 0.2, 0.4, 0.8)  # of the range
_NAMES = ("linear", "quadratic", "cubic")
_UNITS = ("N m/rad", "N m/rad²", "N m/rad³")


class Spring(Effect):
    """A smooth function of the position, the same in both directions.

    Shape: law, lowest and highest position (outside them it is constant), centre, width; law 0: a
    cubic polynomial, 1: linear q + bent sinh((q − centre) / width) (it hardens), 2: the same with
    arctan (it softens). Its constant is the model's offset; of a linear spring the model absorbs
    what looks like gravity, too.

    Simulated by `simulation.effect_kernel.effect_torques`.
    """

    name = "spring"
    order = 130
    family = "position"
    confounders = ("position_ripple", "asymmetric_friction")
    with_constant = True
    excitation = "the whole range of the joint, slowly"
    typical = ShareOf("peak", 0.1)

    def grid(self, place: Place, covered: OperatingRange) -> list[Shape]:
        """All laws, centres over the range, four widths."""
        low, high = (
            float(covered.low[place.joint]),
            float(covered.high[place.joint]),
        )
        if high <= low:
            return []
        bent = [
            (law, low, high, float(centre), width * (high - low))
            for law in (_HARDENING, _SOFTENING)
            for centre in np.linspace(low, high, _CENTRES)
            for width in _WIDTHS
        ]
        return [(_CUBIC, low, high, 0.0, 1.0), *bent]

    def free_numbers(self, shape: Shape) -> int:
        """Centre and width of the bent ones."""
        return 0 if shape[0] == _CUBIC else 2

    def neighbours(
        self, shape: Shape, step: float, place: Place, covered: OperatingRange
    ) -> list[Shape]:
        """Nearby centres and widths."""
        law, low, high, centre, width = shape
        if law == _CUBIC:
            return []
        widest, narrowest = (high - low), 0.05 * (high - low)
        return [
            (law, low, high, centre + step * width, width),
            (law, low, high, centre - step * width, width),
            (law, low, high, centre, min(width * (1.0 + step), widest)),
            (law, low, high, centre, max(width / (1.0 + step), narrowest)),
        ]

    def columns(self, motion: SmoothMotion, place: Place, shape: Shape) -> dict[int, FloatArray]:
        """See the class."""
        law, low, high, centre, width = shape
        q = np.clip(motion.position[:, place.joint], low, high)
        if law == _CUBIC:
            return {place.joint: np.column_stack([q, q**2, q**3])}
        bend = np.sinh if law == _HARDENING else np.arctan
        return {place.joint: np.column_stack([q, bend((q - centre) / width)])}

    def admissible(self, shape: Shape, coefficients: FloatArray) -> bool:
        """Any: the model absorbs what looks like gravity, and what is left has no sign."""
        return True

    def parameters(
        self, shape: Shape, coefficients: FloatArray, deviations: FloatArray
    ) -> dict[str, EffectParameter]:
        """Coefficients, and the range in which they hold."""
        law, low, high, centre, width = shape
        names = _NAMES if law == _CUBIC else (_NAMES[0], "bent")
        units = _UNITS if law == _CUBIC else (_UNITS[0], "N m")
        found = {
            name: number(value, std, unit)
            for name, value, std, unit in zip(names, coefficients, deviations, units, strict=True)
        }
        found["lowest"] = number(low, None, "rad")
        found["highest"] = number(high, None, "rad")
        if law != _CUBIC:
            found["hardening"] = number(1.0 if law == _HARDENING else 0.0, None, "")
            found["centre"] = number(centre, None, "rad")
            found["width"] = number(width, None, "rad")
        return found
