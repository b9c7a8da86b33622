"""Friction that differs between the two directions."""

import numpy as np

from idim_iv_ros.gap.effects.effect import Effect, Extent, FloatArray, Place, Shape, ShareOf, number
from idim_iv_ros.gap.result import EffectParameter
from idim_iv_ros.gap.smooth_motion import SmoothMotion


class AsymmetricFriction(Effect):
    """offset + viscous · |dq|: half the differences of dry and viscous friction.

    A constant torque (of a sensor, a motor, a spring) cannot be told from the first.

    Simulated by `simulation.effect_kernel.effect_torques`.
    """

    name = "asymmetric_friction"
    order = 30
    family = "velocity"
    look_alikes = ("spring",)
    same_as = "an offset of the torque signal"
    excitation = "the same path in both directions, at several speeds and postures"
    counted = False
    typical = ShareOf("dry friction", 0.1)  # 5 to 20 %

    def grid(self, place: Place, extent: Extent) -> list[Shape]:
        """Without and with the viscous part."""
        return [(0.0,), (1.0,)]

    def neighbours(self, shape: Shape, step: float, place: Place, extent: Extent) -> list[Shape]:
        """None: both shapes are tried."""
        return []

    def free_numbers(self, shape: Shape) -> int:
        """See the grid."""
        return 0

    def columns(self, motion: SmoothMotion, place: Place, shape: Shape) -> dict[int, FloatArray]:
        """See the class; shape 0: offset alone."""
        v = np.abs(motion.velocity[:, place.joint])
        both = [np.ones_like(v), v] if shape[0] else [np.ones_like(v)]
        return {place.joint: np.column_stack(both)}

    def admissible(self, shape: Shape, coefficients: FloatArray) -> bool:
        """Either sign."""
        return True

    def parameters(
        self, shape: Shape, coefficients: FloatArray, deviations: FloatArray
    ) -> dict[str, EffectParameter]:
        """Both halves of the differences."""
        found = {"offset": number(coefficients[0], deviations[0], "N m")}
        if shape[0]:
            found["viscous"] = number(coefficients[1], deviations[1], "N m s/rad")
        return found
