"""A transmission part that turns with two joints and has friction of its own."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from idim_iv_ros.compilation import kernel
from idim_iv_ros.effects.cause import GivenNumbers, ParameterSpec
from idim_iv_ros.effects.contribution import (
    LEAST_SPEED,
    CouplingTerm,
    Element,
    Instant,
    Torque,
    TorqueLaw,
)
from idim_iv_ros.effects.effect import JointRange, Place, Shape, ShareOf, StructuralEffect
from idim_iv_ros.effects.motion import RobotMotion, Torques
from idim_iv_ros.types import FloatArray


@dataclass(frozen=True)
class CouplingShape(Shape):
    """Whether the part turns with the sum of both speeds (1) or their difference (−1); power."""

    direction: float
    power: float


@kernel
def _torque(p: FloatArray, at: Instant, state: FloatArray) -> Torque:
    """Values: coulomb, viscous, power; where both signs meet, their sum resists."""
    if p[2] < 1.0:  # its slope at rest has no bound
        return Torque(p[0] + p[1] * at.speed ** p[2], 0.0, 0.0, 0.0)
    speed = max(at.speed, LEAST_SPEED)
    level = max(p[0], 0.0)
    damping = p[1] * at.speed ** (p[2] - 1.0) + min(p[0], 0.0) / speed
    return Torque(level, max(damping, -level / speed), 0.0, 0.0)


class JointCoupling(StructuralEffect[CouplingShape]):
    """coulomb sign(w) + viscous |w|^power sign(w), w = dq_a ± dq_b, on both joints."""

    name = "joint_coupling"
    order = 150
    part = "friction"
    family = "velocity"
    linear = ("coulomb", "viscous")
    ends: ClassVar = {"power": (0.5, 1.6)}
    fixed = ("direction",)
    excitation = "both joints in the same and in opposite directions"
    segments = ("plateau",)
    joints_needed = 2
    typical = ShareOf("dry friction", 0.5)
    specs = (
        ParameterSpec(
            "direction", "", "friction of the sum (1) or the difference (−1) of both speeds",
            1.0, "1 or -1",
        ),
        ParameterSpec("coulomb", "N m", "Coulomb friction of the coupling"),
        ParameterSpec("viscous", "N m at 1 rad/s", "friction of the coupling beyond that"),
        ParameterSpec("power", "", "power of the speed", 1.0, "positive"),
    )  # fmt: skip
    law = TorqueLaw(_torque)
    laws = (law,)
    element_of = "tendon"

    def places(self, joints: int) -> list[Place]:
        """All pairs of joints."""
        return [Place(a, b) for a in range(joints) for b in range(a + 1, joints)]

    def grid(self, covered: JointRange) -> list[CouplingShape]:
        """Linear couplings of joints that turn the same way and opposite ways."""
        return [CouplingShape(1.0, 1.0), CouplingShape(-1.0, 1.0)]

    def columns(self, motion: RobotMotion, place: Place, shape: CouplingShape) -> Torques:
        """Torques on both joints of a coupling whose dry and viscous friction are one."""
        a, b = place.joint, place.other
        assert b is not None
        w = motion.velocity[:, a] + shape.direction * motion.velocity[:, b]
        both = np.column_stack([np.sign(w), np.abs(w) ** shape.power * np.sign(w)])
        return {a: both, b: shape.direction * both}

    def admissible(self, shape: CouplingShape, coefficients: FloatArray) -> bool:
        """Whether the coupling dissipates energy on the whole."""
        return bool(np.sum(coefficients) > 0.0)

    def element(self, value: Mapping[str, float], low: float, high: float) -> Element | None:
        """Damping and dry friction of a tendon, where the friction is linear and takes energy."""
        coulomb, viscous = value.get("coulomb", 0.0), value.get("viscous", 0.0)
        if value.get("power", 1.0) != 1.0 or coulomb < 0.0 or viscous < 0.0:
            return None
        return Element(tendon=(value.get("direction", 1.0), viscous, coulomb))

    def contributions(self, given: GivenNumbers) -> list[CouplingTerm]:
        """Friction between both joints, dry where it has a level or no bound at rest."""
        values = given.values("coulomb", "viscous", "power")
        dry = given.value["coulomb"] > 0.0 or given.value["power"] < 1.0
        return [CouplingTerm(self.law, values, given.value["direction"], dry)]
