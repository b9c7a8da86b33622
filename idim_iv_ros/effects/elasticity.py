"""A shaft that twists between motor and link."""

from dataclasses import dataclass

import numpy as np

from idim_iv_ros.effects.cause import GivenNumbers, Parameters, ParameterSpec
from idim_iv_ros.effects.contribution import ShaftPart
from idim_iv_ros.effects.effect import JointRange, Place, Shape, StructuralEffect
from idim_iv_ros.effects.motion import RobotMotion, Torques
from idim_iv_ros.effects.two_masses import transmitted
from idim_iv_ros.types import FloatArray

_DAMPING = (0.03, 0.2)  # times critical
_LOWEST, _HIGHEST = 3.0, 100.0  # Hz, resonance of the link against a motor at rest
_SLOWEST_SWING = 4.0  # Hz: series elastic arms swing at 4 Hz, geared ones at 5 to 25 Hz
_SOFTEST = 11.0  # Hz: the middle of 5 to 25 Hz, where links of arms swing


@dataclass(frozen=True)
class ShaftShape(Shape):
    """Stiffness, N m/rad, and damping, N m s/rad."""

    stiffness: float
    damping: float


class Elasticity(StructuralEffect[ShaftShape]):
    """Two masses on a shaft: what was measured is the motor's position.

    Moves the torques of all joints.
    """

    name = "elasticity"
    order = 90
    part = "shaft"
    family = "frequency"
    excitation = "a sweep to twice the resonance, small amplitude"
    segments = ("multisine",)
    size_in = "scale"
    specs = (
        ParameterSpec("stiffness", "N m/rad", "stiffness of the shaft", None, "positive"),
        ParameterSpec("damping", "N m s/rad", "damping of the shaft", 0.0, "not negative"),
    )

    def grid(self, covered: JointRange) -> list[ShaftShape]:
        """Resonances from 3 to 100 Hz, lightly and well damped."""
        inertia = covered.inertia
        if inertia <= 0.0:
            return []
        shapes: list[ShaftShape] = []
        for frequency in np.geomspace(_LOWEST, _HIGHEST, 16):
            stiffness = inertia * (2.0 * np.pi * float(frequency)) ** 2
            critical = 2.0 * float(np.sqrt(stiffness * inertia))
            shapes += [ShaftShape(stiffness, share * critical) for share in _DAMPING]
        return shapes

    def columns(self, motion: RobotMotion, place: Place, shape: ShaftShape) -> Torques:
        """Change of all torques by a shaft of this shape; its coefficient is one."""
        return transmitted(motion, place.joint, shape.stiffness, shape.damping, 0.0)

    def admissible(self, shape: ShaftShape, coefficients: FloatArray) -> bool:
        """The whole change, not a part of it (softer and stiffer shafts scale it)."""
        return bool(0.3 < coefficients[0] < 3.0)

    def plausible(
        self, shape: ShaftShape, coefficients: FloatArray, torque: float, covered: JointRange
    ) -> bool:
        """Whether the shaft is no softer than the softest that are common."""
        stiffness = shape.stiffness / float(coefficients[0])
        return bool(stiffness >= covered.inertia * (2.0 * np.pi * _SOFTEST) ** 2)

    def impossible(self, shape: ShaftShape, coefficients: FloatArray, covered: JointRange) -> str:
        """Links that swing slower or faster than those of arms, or not at all.

        Far below its resonance a shaft of compliance 1/k turns M τ''/k into torque, as a drive that
        lags by √(M/k) does to second order: the resonance tells them apart.
        """
        inertia = covered.inertia
        stiffness = shape.stiffness / float(coefficients[0])
        if inertia <= 0.0 or stiffness <= 0.0:
            return "the link has no inertia that could swing"
        swing = float(np.sqrt(stiffness / inertia)) / (2.0 * np.pi)
        if not _SLOWEST_SWING <= swing <= _HIGHEST:
            return (
                f"the link would swing at {swing:.3g} Hz, and those of arms swing at "
                f"{_SLOWEST_SWING:.0f} to {_HIGHEST:.0f} Hz"
            )
        damping = shape.damping / (2.0 * float(np.sqrt(stiffness * inertia)))
        if damping > 1.0:
            return f"the shaft would be damped {damping:.2g} times beyond critical, and not swing"
        return ""

    def size_in_words(self, shape: ShaftShape, coefficients: FloatArray, torque: float) -> str:
        """The stiffness alone: its torque depends on how the motion sets it swinging."""
        return f"stiffness {shape.stiffness / float(coefficients[0]):.2g} N m/rad"

    def parameters(
        self, shape: ShaftShape, coefficients: FloatArray, deviations: FloatArray
    ) -> Parameters:
        """Stiffness and damping; the coefficient scales the compliance to first order."""
        stiffness = shape.stiffness / float(coefficients[0])
        return self.numbers(
            stiffness=(stiffness, stiffness * deviations[0] / coefficients[0]),
            damping=(shape.damping, None),
        )

    def contributions(self, given: GivenNumbers) -> list[ShaftPart]:
        """A shaft between motor and link without play."""
        return [ShaftPart(0.0, given.value["stiffness"], given.value["damping"], flanks=False)]
