"""A motor that gives less than commanded at high torque."""

import math
from dataclasses import dataclass

import numpy as np

from idim_iv_ros.compilation import kernel
from idim_iv_ros.effects.cause import Parameters, ParameterSpec
from idim_iv_ros.effects.contribution import DriveLaw
from idim_iv_ros.effects.effect import JointRange, Place, Shape, ShareOf, StructuralEffect
from idim_iv_ros.effects.motion import RobotMotion, Torques
from idim_iv_ros.types import FloatArray


@dataclass(frozen=True)
class KneeShape(Shape):
    """Torque beyond which the drive saturates, N m (N)."""

    knee: float


@kernel
def _curve(p: FloatArray, command: float) -> float:
    """Acting torque of a command from the parameters p = (knee, slope)."""
    size = abs(command)
    if size > p[0]:
        size = p[0] + p[1] * (size - p[0])
    return math.copysign(size, command)


class TorqueSaturation(StructuralEffect[KneeShape]):
    """Command beyond the knee: the acting torque rises with a smaller slope.

    For the torque τ that acts, the command is τ + coefficient · (|τ| − knee)₊ sign(τ).
    """

    name = "torque_saturation"
    order = 110
    part = "limit"
    family = "load"
    excitation = "high accelerations with a payload, up to the torque limit"
    beyond_motion = "needs torques near the limit: add a payload, or raise --margin"
    beyond_knee = True
    typical = ShareOf("peak", 0.05)  # 0 to 15 %
    specs = (
        ParameterSpec("knee", "N m", "torque from which on it saturates", None, "positive"),
        ParameterSpec("slope", "", "share of the torque beyond that acts", bound="not negative"),
    )
    laws = (DriveLaw(_curve, rank=0),)

    def grid(self, covered: JointRange) -> list[KneeShape]:
        """Knees from 15 to 95 % of the largest torque."""
        return [KneeShape(float(share * covered.torque)) for share in np.linspace(0.15, 0.95, 17)]

    def neighbours(self, shape: KneeShape, step: float, covered: JointRange) -> list[KneeShape]:
        """Shapes with a nearby knee, in smaller steps: few rows lie beyond it."""
        return super().neighbours(shape, 0.3 * step, covered)

    def columns(self, motion: RobotMotion, place: Place, shape: KneeShape) -> Torques:
        """Torque beyond the knee."""
        torque = motion.torque[:, place.joint]
        beyond = np.maximum(np.abs(torque) - shape.knee, 0.0)
        return {place.joint: (np.sign(torque) * beyond)[:, None]}

    def parameters(
        self, shape: KneeShape, coefficients: FloatArray, deviations: FloatArray
    ) -> Parameters:
        """Knee, and slope of the torque beyond it."""
        slope = 1.0 / (1.0 + max(float(coefficients[0]), 0.0))
        return self.numbers(knee=(shape.knee, None), slope=(slope, deviations[0] * slope**2))
