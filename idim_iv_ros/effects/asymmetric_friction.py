"""Viscous friction that differs between the two directions."""

import numpy as np

from idim_iv_ros.diagnosis.refit.smooth_motion import SmoothMotion
from idim_iv_ros.diagnosis.result import EffectParameter
from idim_iv_ros.effects.effect import Effect, OperatingRange, Place, Shape, ShareOf, column, number
from idim_iv_ros.types import FloatArray


class AsymmetricFriction(Effect):
    """viscous · |dq|: half the difference of viscous friction between the directions.

    Half the difference of dry friction is a constant torque, which the model has: it is a
    `torque_offset`, which no recording separates from it.

    Simulated by `simulation.effect_kernel.effect_torques`.
    """

    name = "asymmetric_friction"
    order = 30
    family = "velocity"
    confounders = ("spring",)
    excitation = "the same path in both directions, at several speeds and postures"
    typical = ShareOf("dry friction", 0.1)  # 5 to 20 %

    def grid(self, place: Place, covered: OperatingRange) -> list[Shape]:
        """One."""
        return [()]

    def neighbours(
        self, shape: Shape, step: float, place: Place, covered: OperatingRange
    ) -> list[Shape]:
        """None."""
        return []

    def columns(self, motion: SmoothMotion, place: Place, shape: Shape) -> dict[int, FloatArray]:
        """See the class."""
        return column(place.joint, np.abs(motion.velocity[:, place.joint]))

    def admissible(self, shape: Shape, coefficients: FloatArray) -> bool:
        """Either sign."""
        return True

    def parameters(
        self, shape: Shape, coefficients: FloatArray, deviations: FloatArray
    ) -> dict[str, EffectParameter]:
        """Half the difference."""
        return {"viscous": number(coefficients[0], deviations[0], "N m s/rad")}
