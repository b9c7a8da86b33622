"""Friction that changes during the session: warm-up."""

import math
from dataclasses import dataclass

import numpy as np

from idim_iv_ros.compilation import kernel
from idim_iv_ros.effects.cause import EffectParameter, GivenNumbers, ParameterSpec
from idim_iv_ros.effects.contribution import Instant, Torque, TorqueLaw, TorqueTerm
from idim_iv_ros.effects.effect import (
    OperatingRange,
    Place,
    Shape,
    ShareOf,
    StructuralEffect,
    logarithmic,
)
from idim_iv_ros.effects.motion import RobotMotion
from idim_iv_ros.types import FloatArray

_LEAST_SESSION = 20.0  # s


@dataclass(frozen=True)
class DriftShape(Shape):
    """Time constant, s."""

    time_constant: float


@kernel
def _torque(p: FloatArray, at: Instant, state: FloatArray) -> Torque:
    """Values: time constant, coulomb, viscous."""
    left = math.exp(-at.time / p[0])
    return Torque(left * p[1], left * p[2], 0.0, 0.0)


_LAW = TorqueLaw(_torque)


class FrictionDrift(StructuralEffect[DriftShape]):
    """exp(−t / time_constant) · (coulomb sign(dq) + viscous dq), t since the first recording."""

    name = "friction_drift"
    order = 60
    family = "time"
    confounders = ("nonlinear_viscous",)
    excitation = "one motion repeated at the start, in the middle and at the end of the session"
    segments = ("repeat",)
    typical = ShareOf("dry friction", 0.4)  # 30 to 60 %
    specs = (
        ParameterSpec("time_constant", "s", default=None, bound="positive"),
        ParameterSpec("coulomb", "N m", "Coulomb friction at the start beyond that at the end"),
        ParameterSpec(
            "viscous", "N m s/rad", "viscous friction at the start beyond that at the end"
        ),
    )
    laws = (_LAW,)

    def grid(self, place: Place, covered: OperatingRange) -> list[DriftShape]:
        """From a twentieth of the session to three of it, which is a straight line."""
        times = logarithmic(0.05 * covered.duration, 3 * covered.duration, 8)
        return [DriftShape(float(time)) for time in times]

    def cannot_show(self, joint: int, covered: OperatingRange) -> str:
        """It needs a session that warms the joint up."""
        if covered.duration >= _LEAST_SESSION:
            return ""
        return f"the session lasts {covered.duration:.2g} s: no warm-up shows in that"

    def columns(
        self, motion: RobotMotion, place: Place, shape: DriftShape
    ) -> dict[int, FloatArray]:
        """Dry and viscous friction of one that fade."""
        v = motion.velocity[:, place.joint]
        fading = np.exp(-motion.time / shape.time_constant)
        return {place.joint: fading[:, None] * np.column_stack([motion.slip[:, place.joint], v])}

    def admissible(self, shape: DriftShape, coefficients: FloatArray) -> bool:
        """Friction may fall or rise."""
        return True

    def parameters(
        self, shape: DriftShape, coefficients: FloatArray, deviations: FloatArray
    ) -> dict[str, EffectParameter]:
        """What fades, and how fast."""
        return self.numbers(
            time_constant=(shape.time_constant, None),
            coulomb=(coefficients[0], deviations[0]),
            viscous=(coefficients[1], deviations[1]),
        )

    def contributions(self, given: GivenNumbers) -> list[TorqueTerm]:
        """Friction, its Coulomb part dry."""
        values = tuple(given.value[name] for name in ("time_constant", "coulomb", "viscous"))
        return [TorqueTerm(_LAW, values, friction=True, dry=True)]
