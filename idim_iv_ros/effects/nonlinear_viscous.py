"""Viscous friction that is not proportional to the speed."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from idim_iv_ros.compilation import kernel
from idim_iv_ros.effects.cause import GivenNumbers, ParameterSpec
from idim_iv_ros.effects.contribution import Element, Instant, Torque, TorqueLaw, TorqueTerm
from idim_iv_ros.effects.effect import JointRange, Place, Shape, ShareOf, StructuralEffect
from idim_iv_ros.effects.motion import RobotMotion, Torques
from idim_iv_ros.types import FloatArray

_POWERS = (0.3, 0.45, 0.6, 0.75, 1.4, 1.7, 2.0, 2.5, 3.0)


@dataclass(frozen=True)
class PowerShape(Shape):
    """Power of the speed that the friction follows."""

    power: float


@kernel
def _torque(p: FloatArray, at: Instant, state: FloatArray) -> Torque:
    """Torque for the simulator from the parameters p = (coefficient, power)."""
    if p[1] >= 1.0:
        return Torque(0.0, p[0] * at.speed ** (p[1] - 1.0), 0.0, 0.0)
    # Its slope at rest has no bound.
    return Torque(p[0] * at.speed ** p[1], 0.0, 0.0, 0.0)


class NonlinearViscous(StructuralEffect[PowerShape]):
    """coefficient · |dq|^power · sign(dq).

    Friction that grows more slowly than the speed is common: powers below one belong to it.
    """

    name = "nonlinear_viscous"
    order = 20
    part = "friction"
    family = "velocity"
    linear = ("coefficient",)
    bends_with_speed = True
    excitation = "stretches of constant speed over the whole range of speeds"
    segments = ("plateau",)
    typical = ShareOf("dry friction", 0.5)
    specs = (
        ParameterSpec("coefficient", "N m at 1 rad/s", "friction"),
        ParameterSpec("power", "", "power of the speed", 2.0, "positive"),
    )
    law = TorqueLaw(_torque)
    laws = (law,)
    element_of = "joint"

    def grid(self, covered: JointRange) -> list[PowerShape]:
        """Powers from 0.3 to 3, not around 1, which the model has."""
        return [PowerShape(power) for power in _POWERS]

    def columns(self, motion: RobotMotion, place: Place, shape: PowerShape) -> Torques:
        """Friction of a coefficient of one."""
        v = motion.velocity[:, place.joint]
        return {place.joint: (np.abs(v) ** shape.power * motion.slip[:, place.joint])[:, None]}

    def neighbours(self, shape: PowerShape, step: float, covered: JointRange) -> list[PowerShape]:
        """Shapes with a nearby power, between 0.2 and 4 and away from one."""
        near = super().neighbours(shape, step, covered)
        low, high = (0.2, 0.8) if shape.power < 1.0 else (1.25, 4.0)
        return [PowerShape(min(max(neighbour.power, low), high)) for neighbour in near]

    def element(self, value: Mapping[str, float], low: float, high: float) -> Element | None:
        """The second or third number of a damping, where the power is 2 or 3."""
        power, coefficient = value.get("power", 2.0), value.get("coefficient", 0.0)
        if power not in (2.0, 3.0):
            return None
        return Element(damping=(coefficient, 0.0) if power == 2.0 else (0.0, coefficient))

    def instead_of(self, kind: str, value: float) -> dict[str, float]:
        """A drag with power 1 that stands for a negative Fv."""
        return {"coefficient": value, "power": 1.0} if kind == "Fv" else {}

    def contributions(self, given: GivenNumbers) -> list[TorqueTerm]:
        """Friction, dry where its slope at rest has no bound."""
        power = given.value["power"]
        values = (given.value["coefficient"], power)
        return [TorqueTerm(self.law, values, friction=True, dry=power < 1.0)]
