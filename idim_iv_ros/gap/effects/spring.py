"""A spring on the joint: a gravity compensator, a cable, a hose."""

import numpy as np

from idim_iv_ros.gap.effects.effect import Effect, Extent, FloatArray, Place, Shape, number
from idim_iv_ros.gap.result import EffectParameter
from idim_iv_ros.gap.smooth_motion import SmoothMotion

_UNITS = ("N m", "N m/rad", "N m/rad²", "N m/rad³")
_NAMES = ("constant", "linear", "quadratic", "cubic")


class Spring(Effect):
    """Polynomial of the position, up to the third power; shape: lowest and highest position."""

    name = "spring"
    family = "position"
    look_alikes = ("position_ripple", "asymmetric_friction")
    excitation = "the whole range of the joint, slowly"

    def grid(self, place: Place, extent: Extent) -> list[Shape]:
        """The range that was seen."""
        return [(float(extent.low[place.joint]), float(extent.high[place.joint]))]

    def neighbours(self, shape: Shape, step: float, extent: Extent) -> list[Shape]:
        """None."""
        return []

    def free_numbers(self, shape: Shape) -> int:
        """See the grid."""
        return 0

    def columns(self, motion: SmoothMotion, place: Place, shape: Shape) -> dict[int, FloatArray]:
        """See the class."""
        q = np.clip(motion.position[:, place.joint], *shape)
        return {place.joint: np.column_stack([q**k for k in range(4)])}

    def admissible(self, shape: Shape, coefficients: FloatArray) -> bool:
        """Any: the model absorbs what looks like gravity, and what is left has no sign."""
        return True

    def parameters(
        self, shape: Shape, coefficients: FloatArray, deviations: FloatArray
    ) -> dict[str, EffectParameter]:
        """Coefficients, and the range in which they hold."""
        found = {
            name: number(coefficients[k], deviations[k], _UNITS[k])
            for k, name in enumerate(_NAMES)
        }
        found["lowest"] = number(shape[0], None, "rad")
        found["highest"] = number(shape[1], None, "rad")
        return found
