"""A motor that gives less than commanded at high torque."""

import numpy as np

from idim_iv_ros.diagnosis.refit.smooth_motion import SmoothMotion
from idim_iv_ros.diagnosis.result import EffectParameter
from idim_iv_ros.effects.effect import Effect, OperatingRange, Place, Shape, ShareOf, column, number
from idim_iv_ros.types import FloatArray


class TorqueSaturation(Effect):
    """Command beyond the knee: the acting torque rises with a smaller slope; shape: knee, N m.

    For the torque τ that acts, the command is τ + coefficient · (|τ| − knee)₊ sign(τ).

    Simulated by `simulation.effect_kernel.acting_torque`.
    """

    name = "torque_saturation"
    order = 110
    family = "load"
    confounders = ("load_dependent_friction", "nonlinear_viscous")
    excitation = "high accelerations with a payload, up to the torque limit"
    typical = ShareOf("peak", 0.05)  # 0 to 15 %

    def grid(self, place: Place, covered: OperatingRange) -> list[Shape]:
        """Knees from 15 to 95 % of the largest torque."""
        return [
            (float(share * covered.torque[place.joint]),) for share in np.linspace(0.15, 0.95, 17)
        ]

    def neighbours(
        self, shape: Shape, step: float, place: Place, covered: OperatingRange
    ) -> list[Shape]:
        """A smaller step: the tail is short."""
        return super().neighbours(shape, 0.3 * step, place, covered)

    def columns(self, motion: SmoothMotion, place: Place, shape: Shape) -> dict[int, FloatArray]:
        """See the class."""
        torque = motion.torque[:, place.joint]
        return column(place.joint, np.sign(torque) * np.maximum(np.abs(torque) - shape[0], 0.0))

    def parameters(
        self, shape: Shape, coefficients: FloatArray, deviations: FloatArray
    ) -> dict[str, EffectParameter]:
        """Knee and slope beyond it."""
        slope = 1.0 / (1.0 + max(float(coefficients[0]), 0.0))
        return {
            "knee": number(shape[0], None, "N m"),
            "slope": number(slope, deviations[0] * slope**2, ""),
        }
