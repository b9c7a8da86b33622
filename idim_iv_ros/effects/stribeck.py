"""Stribeck effect: dry friction that falls as a joint starts to slide."""

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from idim_iv_ros.compilation import kernel
from idim_iv_ros.effects.cause import ParameterSpec
from idim_iv_ros.effects.contribution import Instant, Torque, TorqueLaw
from idim_iv_ros.effects.effect import JointRange, Place, Shape, ShareOf, StructuralEffect
from idim_iv_ros.effects.motion import RobotMotion, Torques
from idim_iv_ros.types import FloatArray

_EXPONENTS = (0.6, 1.0, 2.0)
_NEVER = 1e6  # rad/s: no joint comes near such a speed, and the excess is constant


@dataclass(frozen=True)
class StribeckShape(Shape):
    """Stribeck speed, rad/s, and exponent of the speed over it."""

    speed: float
    exponent: float


@kernel
def _torque(p: FloatArray, at: Instant, state: FloatArray) -> Torque:
    """Torque for the simulator from the parameters p = (excess, speed, exponent)."""
    return Torque(p[0] * math.exp(-((at.speed / p[1]) ** p[2])), 0.0, 0.0, 0.0)


class Stribeck(StructuralEffect[StribeckShape]):
    """excess · exp(−(|dq| / speed)^exponent) · sign(dq).

    Static friction exceeds sliding friction: the excess is not negative.
    """

    name = "stribeck"
    order = 10
    part = "friction"
    family = "velocity"
    linear = ("excess",)
    dry = True
    bends_with_speed = True
    ends: ClassVar = {"exponent": (0.5, 2.5)}
    excitation = "slow sweeps in both directions: a fifth of the time below the Stribeck speed"
    segments = ("creep",)
    typical = ShareOf("dry friction", 0.2)  # static over dry friction 1.05 to 1.6
    specs = (
        ParameterSpec("excess", "N m", "dry friction at rest beyond that in motion"),
        ParameterSpec("speed", "rad/s", "Stribeck speed", None, "positive"),
        ParameterSpec("exponent", "", "exponent of speed over Stribeck speed", 2.0, "positive"),
    )
    laws = (TorqueLaw(_torque),)

    def grid(self, covered: JointRange) -> list[StribeckShape]:
        """Speeds from the slowest that counts to a third of the fastest."""
        low = covered.slowest
        speeds = np.geomspace(low, max(0.35 * covered.fastest, 1.01 * low), 8)
        return [StribeckShape(float(v), exponent) for v in speeds for exponent in _EXPONENTS]

    def columns(self, motion: RobotMotion, place: Place, shape: StribeckShape) -> Torques:
        """Friction of an excess of one."""
        v = np.abs(motion.velocity[:, place.joint])
        falling = np.exp(-((v / shape.speed) ** shape.exponent))
        return {place.joint: (falling * motion.slip[:, place.joint])[:, None]}

    def instead_of(self, kind: str, value: float) -> dict[str, float]:
        """An excess at every speed that stands for a negative Fc."""
        return {"excess": value, "speed": _NEVER} if kind == "Fc" else {}
