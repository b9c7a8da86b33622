"""Stribeck effect: dry friction that falls as a joint starts to slide."""

import numpy as np

from idim_iv_ros.diagnosis.refit.smooth_motion import SmoothMotion
from idim_iv_ros.diagnosis.result import EffectParameter
from idim_iv_ros.effects.bent_friction import too_slow_to_bend
from idim_iv_ros.effects.effect import (
    Effect,
    OperatingRange,
    Place,
    Shape,
    ShareOf,
    column,
    logarithmic,
    number,
)
from idim_iv_ros.types import FloatArray

_EXPONENTS = (0.6, 1.0, 2.0)


class Stribeck(Effect):
    """excess · exp(−(|dq| / speed)^exponent) · sign(dq); shape: speed, exponent.

    Static friction exceeds sliding friction: the excess is not negative.

    Simulated by `simulation.effect_kernel.effect_torques`.
    """

    name = "stribeck"
    order = 10
    family = "velocity"
    confounders = ("nonlinear_viscous", "presliding")
    excitation = "slow sweeps in both directions: a fifth of the time below the Stribeck speed"
    typical = ShareOf("dry friction", 0.2)  # static over dry friction 1.05 to 1.6

    def grid(self, place: Place, covered: OperatingRange) -> list[Shape]:
        """Speeds from the slowest that counts to a third of the fastest."""
        j = place.joint
        speeds = logarithmic(covered.slowest[j], 0.35 * covered.fastest[j], 8)
        return [(float(speed), exponent) for speed in speeds for exponent in _EXPONENTS]

    def cannot_show(self, joint: int, covered: OperatingRange) -> str:
        """It needs speed."""
        return too_slow_to_bend(joint, covered)

    def columns(self, motion: SmoothMotion, place: Place, shape: Shape) -> dict[int, FloatArray]:
        """See the class."""
        speed, exponent = shape
        v = motion.velocity[:, place.joint]
        return column(
            place.joint, np.exp(-((np.abs(v) / speed) ** exponent)) * motion.slip[:, place.joint]
        )

    def neighbours(
        self, shape: Shape, step: float, place: Place, covered: OperatingRange
    ) -> list[Shape]:
        """Exponents stay between 0.5 and 2.5."""
        near = super().neighbours(shape, step, place, covered)
        return [(speed, min(max(exponent, 0.5), 2.5)) for speed, exponent in near]

    def parameters(
        self, shape: Shape, coefficients: FloatArray, deviations: FloatArray
    ) -> dict[str, EffectParameter]:
        """Excess, speed and exponent."""
        return {
            "excess": number(coefficients[0], deviations[0], "N m"),
            "speed": number(shape[0], None, "rad/s"),
            "exponent": number(shape[1], None, ""),
        }
