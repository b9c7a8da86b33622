"""A transmission part that turns with two joints and has friction of its own."""

import numpy as np

from idim_iv_ros.diagnosis.refit.smooth_motion import SmoothMotion
from idim_iv_ros.diagnosis.result import EffectParameter
from idim_iv_ros.effects.effect import (
    Effect,
    OperatingRange,
    Place,
    Shape,
    ShareOf,
    direction,
    number,
)
from idim_iv_ros.types import FloatArray


class JointCoupling(Effect):
    """coulomb sign(w) + viscous |w|^power sign(w), w = dq_a ± dq_b, on both joints.

    Shape: direction ±1, power.

    Simulated by `simulation.effect_kernel.effect_torques`.
    """

    name = "joint_coupling"
    order = 150
    family = "velocity"
    confounders = ("nonlinear_viscous", "stribeck")
    excitation = "both joints in the same and in opposite directions"
    typical = ShareOf("dry friction", 0.5)

    def places(self, joints: int) -> list[Place]:
        """Every pair."""
        return [Place(a, b) for a in range(joints) for b in range(a + 1, joints)]

    def grid(self, place: Place, covered: OperatingRange) -> list[Shape]:
        """Both directions, linear."""
        return [(1.0, 1.0), (-1.0, 1.0)]

    def neighbours(
        self, shape: Shape, step: float, place: Place, covered: OperatingRange
    ) -> list[Shape]:
        """The power between 0.5 and 1.6."""
        sign, power = shape
        near = (power * (1.0 + step), power / (1.0 + step))
        return [(sign, min(max(p, 0.5), 1.6)) for p in near]

    def free_numbers(self, shape: Shape) -> int:
        """See the grid."""
        return 2

    def columns(self, motion: SmoothMotion, place: Place, shape: Shape) -> dict[int, FloatArray]:
        """See the class."""
        sign, power = shape
        a, b = place.joint, place.other
        assert b is not None
        w = motion.velocity[:, a] + sign * motion.velocity[:, b]
        both = np.column_stack([direction(w), np.abs(w) ** power * direction(w)])
        return {a: both, b: sign * both}

    def admissible(self, shape: Shape, coefficients: FloatArray) -> bool:
        """It takes energy on the whole."""
        return bool(np.sum(coefficients) > 0.0)

    def parameters(
        self, shape: Shape, coefficients: FloatArray, deviations: FloatArray
    ) -> dict[str, EffectParameter]:
        """Friction of the common part."""
        return {
            "direction": number(shape[0], None, ""),
            "coulomb": number(coefficients[0], deviations[0], "N m"),
            "viscous": number(coefficients[1], deviations[1], "N m at 1 rad/s"),
            "power": number(shape[1], None, ""),
        }
