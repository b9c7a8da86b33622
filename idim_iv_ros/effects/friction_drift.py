"""Friction that changes during the session: warm-up."""

import math
from dataclasses import dataclass

import numpy as np

from idim_iv_ros.compilation import kernel
from idim_iv_ros.effects.cause import ParameterSpec
from idim_iv_ros.effects.contribution import Instant, Torque, TorqueLaw
from idim_iv_ros.effects.effect import (
    OperatingRange,
    Place,
    Shape,
    ShareOf,
    StructuralEffect,
    logarithmic,
)
from idim_iv_ros.effects.motion import RobotMotion, Torques
from idim_iv_ros.types import FloatArray


@dataclass(frozen=True)
class DriftShape(Shape):
    """How friction fades: time constant, s, and whether the clock restarts with each recording.

    It does where a robot rests in between; else it runs through the session.
    """

    time_constant: float
    restarts: bool


@kernel
def _torque(p: FloatArray, at: Instant, state: FloatArray) -> Torque:
    """Values: time constant, coulomb, viscous, restarts."""
    left = math.exp(-(at.elapsed if p[3] == 1.0 else at.time) / p[0])
    return Torque(left * p[1], left * p[2], 0.0, 0.0)


class FrictionDrift(StructuralEffect[DriftShape]):
    """exp(−t / time_constant) · (coulomb sign(dq) + viscous dq), t of the session or recording."""

    name = "friction_drift"
    order = 60
    part = "friction"
    family = "time"
    linear = ("coulomb", "viscous")
    dry = True
    signed = True  # friction may fall or rise
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
        ParameterSpec(
            "restarts", "", "clock that starts anew with each recording (1) or not (0)",
            bound="0 or 1",
        ),
    )  # fmt: skip
    laws = (TorqueLaw(_torque),)

    def grid(self, place: Place, covered: OperatingRange) -> list[DriftShape]:
        """From a twentieth of the session to three of it, which is a straight line.

        Of several recordings also from a tenth of the longest to three of it, anew in each.
        """
        session = logarithmic(0.05 * covered.duration, 3.0 * covered.duration, 8)
        recording = logarithmic(0.1 * covered.longest, 3.0 * covered.longest, 7)
        several = covered.longest < covered.duration
        return [
            *(DriftShape(float(time), False) for time in session),
            *(DriftShape(float(time), True) for time in recording if several),
        ]

    def columns(self, motion: RobotMotion, place: Place, shape: DriftShape) -> Torques:
        """Dry and viscous friction of unit size that fade."""
        v = motion.velocity[:, place.joint]
        time = motion.elapsed if shape.restarts else motion.time
        fading = np.exp(-time / shape.time_constant)
        return {place.joint: fading[:, None] * np.column_stack([motion.slip[:, place.joint], v])}

    def meaning(self, shape: DriftShape) -> str:
        """Whether the drift runs through the session or begins anew, in words."""
        return "anew in each recording" if shape.restarts else "through the session"
