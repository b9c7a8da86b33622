"""Play between motor and link."""

import numpy as np

from idim_iv_ros.diagnosis.refit.smooth_motion import SmoothMotion
from idim_iv_ros.diagnosis.result import EffectParameter
from idim_iv_ros.effects.effect import (
    Effect,
    JointScale,
    OperatingRange,
    Place,
    Shape,
    logarithmic,
    number,
)
from idim_iv_ros.effects.two_masses import transmitted
from idim_iv_ros.types import FloatArray

_FLANKS = (12.0, 25.0, 50.0)  # Hz, of the link on a flank
# Of the bending of the flanks under the largest load.
_LEAST_GAP = 0.3
_DAMPING = 0.3  # times critical, of the flanks
_TYPICAL_GAP = 0.001  # rad, of 0.1 to 10 mrad; 0.01 to 1 mm


class Backlash(Effect):
    """Two masses with a dead zone: the link flies free while the load changes its side.

    Moves the torques of all joints. Shape: gap rad, stiffness of the flanks N m/rad, their
    damping, and the largest load. With flanks that bend further under it than the gap is wide, it
    is a shaft.

    Simulated by `simulation.shaft.shafts_of` and `simulation.effect_kernel.effect_torques`.
    """

    name = "backlash"
    order = 80
    family = "load"
    confounders = ("elasticity", "presliding")
    of_high_derivatives = True
    free_shape = False
    excitation = "slow motion through postures where the load changes its sign"
    size_in = "shape"

    def grid(self, place: Place, covered: OperatingRange) -> list[Shape]:
        """Gaps from 0.1 to 40 mrad (10 µm to 4 mm)."""
        inertia = float(covered.inertia[place.joint])
        if inertia <= 0.0:
            return []
        load = float(covered.load[place.joint])
        gaps = float(covered.lever[place.joint]) * logarithmic(1e-4, 0.04, 9)
        shapes: list[Shape] = []
        for frequency in _FLANKS:
            stiffness = inertia * (2.0 * np.pi * frequency) ** 2
            damping = 2.0 * _DAMPING * float(np.sqrt(stiffness * inertia))
            shapes += [(float(gap), stiffness, damping, load) for gap in gaps]
        return [shape for shape in shapes if _wide(shape)]

    def neighbours(
        self, shape: Shape, step: float, place: Place, covered: OperatingRange
    ) -> list[Shape]:
        """Gap and flanks; their damping follows."""
        gap, stiffness, damping, load = shape
        root = float(np.sqrt(1.0 + step))
        near: list[Shape] = [
            (gap * (1.0 + step), stiffness, damping, load),
            (gap / (1.0 + step), stiffness, damping, load),
            (gap, stiffness * (1.0 + step), damping * root, load),
            (gap, stiffness / (1.0 + step), damping / root, load),
            (gap, stiffness, damping * (1.0 + 2.0 * step), load),
            (gap, stiffness, damping / (1.0 + 2.0 * step), load),
        ]
        return [shape for shape in near if _wide(shape)]

    def free_numbers(self, shape: Shape) -> int:
        """Gap, flanks and their damping."""
        return 3

    def columns(self, motion: SmoothMotion, place: Place, shape: Shape) -> dict[int, FloatArray]:
        """See the class."""
        gap, stiffness, damping, _ = shape
        return transmitted(motion, place.joint, stiffness, damping, gap)

    def admissible(self, shape: Shape, coefficients: FloatArray) -> bool:
        """The whole change, not a part of it."""
        return bool(0.3 < coefficients[0] < 3.0)

    def plausible(
        self, shape: Shape, coefficients: FloatArray, torque: float, scale: JointScale
    ) -> bool:
        """Gaps up to the middle of what arms have."""
        return bool(shape[0] <= _TYPICAL_GAP * float(scale.covered.lever[scale.joint]))

    def parameters(
        self, shape: Shape, coefficients: FloatArray, deviations: FloatArray
    ) -> dict[str, EffectParameter]:
        """Gap and flanks."""
        relative = deviations[0] / coefficients[0]
        return {
            "gap": number(shape[0], shape[0] * relative, "rad"),
            "stiffness": number(shape[1], None, "N m/rad"),
            "damping": number(shape[2], None, "N m s/rad"),
        }


def _wide(shape: Shape) -> bool:
    """Whether the gap shows beside the bending of its flanks."""
    gap, stiffness, _, load = shape
    return gap * stiffness > _LEAST_GAP * load
