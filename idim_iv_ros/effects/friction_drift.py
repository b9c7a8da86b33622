"""Friction that changes during the session: warm-up."""

import numpy as np

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

_LEAST_SESSION = 20.0  # s


class FrictionDrift(Effect):
    """exp(−t / time_constant) · (coulomb sign(dq) + viscous dq), t since the first recording.

    Shape: time constant, s.

    Simulated by `simulation.effect_kernel.effect_torques`.
    """

    name = "friction_drift"
    order = 60
    family = "time"
    confounders = ("nonlinear_viscous",)
    excitation = "one motion repeated at the start, in the middle and at the end of the session"
    typical = ShareOf("dry friction", 0.4)  # 30 to 60 %

    def grid(self, place: Place, covered: OperatingRange) -> list[Shape]:
        """From a twentieth of the session to three of it, which is a straight line."""
        return [(float(t),) for t in logarithmic(0.05 * covered.duration, 3 * covered.duration, 8)]

    def cannot_show(self, joint: int, covered: OperatingRange) -> str:
        """It needs a session that warms the joint up."""
        if covered.duration >= _LEAST_SESSION:
            return ""
        return f"the session lasts {covered.duration:.2g} s: no warm-up shows in that"

    def columns(self, motion: SmoothMotion, place: Place, shape: Shape) -> dict[int, FloatArray]:
        """See the class."""
        v = motion.velocity[:, place.joint]
        fading = np.exp(-motion.time / shape[0])
        return {place.joint: fading[:, None] * np.column_stack([motion.slip[:, place.joint], v])}

    def admissible(self, shape: Shape, coefficients: FloatArray) -> bool:
        """Friction may fall or rise."""
        return True

    def parameters(
        self, shape: Shape, coefficients: FloatArray, deviations: FloatArray
    ) -> dict[str, EffectParameter]:
        """What fades, and how fast."""
        return {
            "time_constant": number(shape[0], None, "s"),
            "coulomb": number(coefficients[0], deviations[0], "N m"),
            "viscous": number(coefficients[1], deviations[1], "N m s/rad"),
        }
