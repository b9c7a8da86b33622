"""Dry friction that grows with the load of the transmission."""

import numpy as np

from idim_iv_ros.diagnosis.refit.smooth_motion import SmoothMotion
from idim_iv_ros.diagnosis.result import EffectParameter
from idim_iv_ros.effects.effect import Effect, JointScale, OperatingRange, Place, Shape, number
from idim_iv_ros.types import FloatArray

_TYPICAL = 0.1  # of the load: 3 to 40 %


class LoadDependentFriction(Effect):
    """sign(dq) · scale (|τ| / scale)^exponent · (driving or driven); τ: torque of the links.

    Shape: exponent, scale (the largest load), 1 where both directions of the power flow have a
    coefficient of their own (a gear that is driven loses less or more than one that drives), and
    1 where the load is the motor's whole torque instead of that of the links.

    Simulated by `simulation.effect_kernel.effect_torques`.
    """

    name = "load_dependent_friction"
    order = 40
    family = "load"
    confounders = ("position_dependent_friction", "torque_saturation")
    excitation = "one path with two payloads, or slowly through postures of high and low gravity"

    def grid(self, place: Place, covered: OperatingRange) -> list[Shape]:
        """Exponents about one, one or two coefficients."""
        scale = float(covered.load[place.joint])
        if scale <= 0.0:
            return []
        both = (0.0, 1.0)
        return [(e, scale, two, all_) for e in (0.8, 1.0, 1.3) for two in both for all_ in both]

    def neighbours(
        self, shape: Shape, step: float, place: Place, covered: OperatingRange
    ) -> list[Shape]:
        """Exponents between 0.6 and 1.6."""
        exponent, scale, two, motor = shape
        near = (exponent * (1.0 + step), exponent / (1.0 + step))
        return [(min(max(e, 0.6), 1.6), scale, two, motor) for e in near]

    def free_numbers(self, shape: Shape) -> int:
        """See the grid."""
        return 1

    def columns(self, motion: SmoothMotion, place: Place, shape: Shape) -> dict[int, FloatArray]:
        """See the class."""
        exponent, scale, two, motor = shape
        v = motion.velocity[:, place.joint]
        load = (motion.torque if motor else motion.load)[:, place.joint]
        whole = scale * (np.abs(load) / scale) ** exponent * motion.slip[:, place.joint]
        if not two:
            return {place.joint: whole[:, None]}
        driving = load * v > 0.0
        return {place.joint: np.column_stack([whole * driving, whole * ~driving])}

    def admissible(self, shape: Shape, coefficients: FloatArray) -> bool:
        """Friction: both grow with the load."""
        return bool(np.all(coefficients >= 0.0))

    def plausible(
        self, shape: Shape, coefficients: FloatArray, torque: float, scale: JointScale
    ) -> bool:
        """Coefficients up to the middle of what gears have."""
        return bool(max(coefficients[0], coefficients[-1]) <= _TYPICAL)

    def parameters(
        self, shape: Shape, coefficients: FloatArray, deviations: FloatArray
    ) -> dict[str, EffectParameter]:
        """Coefficients of friction when driving and when driven."""
        last = len(coefficients) - 1
        return {
            "driving": number(coefficients[0], deviations[0], ""),
            "driven": number(coefficients[last], deviations[last], ""),
            "exponent": number(shape[0], None, ""),
            "scale": number(shape[1], None, "N m"),
            "motor_torque": number(shape[3], None, ""),
        }
