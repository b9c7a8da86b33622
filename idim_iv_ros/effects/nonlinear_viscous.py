"""Viscous friction that is not proportional to the speed."""

import numpy as np

from idim_iv_ros.diagnosis.refit.smooth_motion import SmoothMotion
from idim_iv_ros.diagnosis.result import EffectParameter
from idim_iv_ros.effects.bent_friction import too_slow_to_bend
from idim_iv_ros.effects.effect import Effect, OperatingRange, Place, Shape, ShareOf, column, number
from idim_iv_ros.types import FloatArray

_POWERS = (0.3, 0.45, 0.6, 0.75, 1.4, 1.7, 2.0, 2.5, 3.0)


class NonlinearViscous(Effect):
    """coefficient · |dq|^power · sign(dq); shape: power.

    Friction that grows more slowly than the speed is common: powers below one belong to it.

    Simulated by `simulation.effect_kernel.effect_torques`.
    """

    name = "nonlinear_viscous"
    order = 20
    family = "velocity"
    confounders = ("stribeck", "friction_drift")
    excitation = "stretches of constant speed over the whole range of speeds"
    typical = ShareOf("dry friction", 0.5)

    def grid(self, place: Place, covered: OperatingRange) -> list[Shape]:
        """Powers from 0.3 to 3, not around 1, which the model has."""
        return [(power,) for power in _POWERS]

    def cannot_show(self, joint: int, covered: OperatingRange) -> str:
        """It needs speed."""
        return too_slow_to_bend(joint, covered)

    def columns(self, motion: SmoothMotion, place: Place, shape: Shape) -> dict[int, FloatArray]:
        """See the class."""
        v = motion.velocity[:, place.joint]
        return column(place.joint, np.abs(v) ** shape[0] * motion.slip[:, place.joint])

    def neighbours(
        self, shape: Shape, step: float, place: Place, covered: OperatingRange
    ) -> list[Shape]:
        """Powers stay between 0.2 and 4, and away from one."""
        near = super().neighbours(shape, step, place, covered)
        low, high = (0.2, 0.8) if shape[0] < 1.0 else (1.25, 4.0)
        return [(min(max(power, low), high),) for (power,) in near]

    def parameters(
        self, shape: Shape, coefficients: FloatArray, deviations: FloatArray
    ) -> dict[str, EffectParameter]:
        """Torque at 1 rad/s, and the power."""
        return {
            "coefficient": number(coefficients[0], deviations[0], "N m at 1 rad/s"),
            "power": number(shape[0], None, ""),
        }
