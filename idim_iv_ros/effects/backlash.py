"""Play between motor and link."""

import math
from dataclasses import dataclass, replace

import numpy as np

from idim_iv_ros.effects.cause import GivenNumbers, Parameters, ParameterSpec
from idim_iv_ros.effects.contribution import ShaftPart
from idim_iv_ros.effects.effect import JointRange, Place, Shape, StructuralEffect
from idim_iv_ros.effects.motion import RobotMotion, Torques
from idim_iv_ros.effects.two_masses import transmitted
from idim_iv_ros.types import FloatArray

_FLANKS = (12.0, 40.0, 130.0)  # Hz, of the link on a flank
# Of the bending of the flanks under the largest load.
_LEAST_GAP = 0.3
_WIDEST = 0.04  # rad, four times that of worn gears; the widest that is tried
_DAMPING = 0.3  # times critical, of the flanks
_TYPICAL_GAP = 0.001  # rad, of 0.1 to 10 mrad; 0.01 to 1 mm


@dataclass(frozen=True)
class BacklashShape(Shape):
    """Gap, rad, stiffness of the flanks, N m/rad, their damping, N m s/rad, and largest load."""

    gap: float
    stiffness: float
    damping: float
    load: float

    @property
    def wide(self) -> bool:
        """Whether the gap is wide against the bending of its flanks; else it acts as a shaft."""
        return self.gap * self.stiffness > _LEAST_GAP * self.load


class Backlash(StructuralEffect[BacklashShape]):
    """Two masses with a dead zone: the link flies free while the load changes its side.

    Moves the torques of all joints. With flanks that bend further under the largest load than the
    gap is wide, it is a shaft.
    """

    name = "backlash"
    order = 80
    part = "play"
    family = "load"
    free_shape = False
    excitation = "slow motion through postures where the load changes its sign"
    segments = ("range_sweep", "creep", "reversals")
    size_in = "shape"
    specs = (
        ParameterSpec("gap", "rad", "whole play", None, "not negative"),
        ParameterSpec("stiffness", "N m/rad", "stiffness beyond the play", math.nan, "positive"),
        ParameterSpec("damping", "N m s/rad", "damping beyond the play", math.nan, "not negative"),
    )

    def grid(self, covered: JointRange) -> list[BacklashShape]:
        """Shapes with gaps from 0.1 to 40 mrad (10 µm to 4 mm) and three stiffnesses."""
        inertia = covered.inertia
        if inertia <= 0.0:
            return []
        gaps = covered.lever * np.geomspace(1e-4, _WIDEST, 9)
        shapes: list[BacklashShape] = []
        for frequency in _FLANKS:
            stiffness = inertia * (2.0 * np.pi * frequency) ** 2
            damping = 2.0 * _DAMPING * float(np.sqrt(stiffness * inertia))
            shapes += [BacklashShape(float(gap), stiffness, damping, covered.load) for gap in gaps]
        return [shape for shape in shapes if shape.wide]

    def neighbours(
        self, shape: BacklashShape, step: float, covered: JointRange
    ) -> list[BacklashShape]:
        """Shapes with another gap, stiffness or damping of the flanks; the damping ratio stays."""
        gap, stiffness, damping = shape.gap, shape.stiffness, shape.damping
        root = float(np.sqrt(1.0 + step))
        near = [
            replace(shape, gap=gap * (1.0 + step)),
            replace(shape, gap=gap / (1.0 + step)),
            replace(shape, stiffness=stiffness * (1.0 + step), damping=damping * root),
            replace(shape, stiffness=stiffness / (1.0 + step), damping=damping / root),
            replace(shape, damping=damping * (1.0 + 2.0 * step)),
            replace(shape, damping=damping / (1.0 + 2.0 * step)),
        ]
        return [neighbour for neighbour in near if neighbour.wide]

    def columns(self, motion: RobotMotion, place: Place, shape: BacklashShape) -> Torques:
        """Change of all torques by play of this shape; its coefficient is one."""
        return transmitted(motion, place.joint, shape.stiffness, shape.damping, shape.gap)

    def admissible(self, shape: BacklashShape, coefficients: FloatArray) -> bool:
        """Whether the coefficient is about one: the whole change by the play, not a part."""
        return bool(0.3 < coefficients[0] < 3.0)

    def plausible(
        self, shape: BacklashShape, coefficients: FloatArray, torque: float, covered: JointRange
    ) -> bool:
        """Whether the gap is no wider than the middle of those that arms have."""
        return bool(shape.gap <= _TYPICAL_GAP * covered.lever)

    def impossible(
        self, shape: BacklashShape, coefficients: FloatArray, covered: JointRange
    ) -> str:
        """Why a gap is wider than that of any broken gear; empty if it is not."""
        widest = _WIDEST * covered.lever
        if shape.gap <= widest:
            return ""
        unit = covered.length
        return f"a play of {shape.gap:.2g} {unit} is beyond {widest:.2g} {unit}"

    def parameters(
        self, shape: BacklashShape, coefficients: FloatArray, deviations: FloatArray
    ) -> Parameters:
        """Gap, stiffness and damping of play, with their deviations."""
        relative = deviations[0] / coefficients[0]
        return self.numbers(
            gap=(shape.gap, shape.gap * relative),
            stiffness=(shape.stiffness, None),
            damping=(shape.damping, None),
        )

    def contributions(self, given: GivenNumbers) -> list[ShaftPart]:
        """A shaft between motor and link with a dead zone."""
        v = given.value
        return [ShaftPart(v["gap"], v["stiffness"], v["damping"], flanks=True)]
