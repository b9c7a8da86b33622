"""A shaft that twists between motor and link."""

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

_DAMPING = (0.03, 0.2)  # times critical
_LOWEST, _HIGHEST = 3.0, 100.0  # Hz, resonance of the link against a motor that stands
_SOFTEST = 11.0  # Hz: the middle of 5 to 25 Hz, where links of arms swing


class Elasticity(Effect):
    """Two masses on a shaft: what was measured is the motor's position.

    Moves the torques of all joints. Shape: stiffness N m/rad, damping N m s/rad.

    Simulated by `simulation.shaft.shafts_of` and `simulation.effect_kernel.effect_torques`.
    """

    name = "elasticity"
    order = 90
    family = "frequency"
    confounders = ("time_delay", "backlash")
    of_high_derivatives = True
    excitation = "a sweep to twice the resonance, small amplitude"
    size_in = "scale"

    def grid(self, place: Place, covered: OperatingRange) -> list[Shape]:
        """Resonances from 3 to 100 Hz, lightly and well damped."""
        inertia = float(covered.inertia[place.joint])
        if inertia <= 0.0:
            return []
        shapes: list[Shape] = []
        for frequency in logarithmic(_LOWEST, _HIGHEST, 16):
            stiffness = inertia * (2.0 * np.pi * float(frequency)) ** 2
            shapes += [(stiffness, 2.0 * z * np.sqrt(stiffness * inertia)) for z in _DAMPING]
        return shapes

    def columns(self, motion: SmoothMotion, place: Place, shape: Shape) -> dict[int, FloatArray]:
        """See the class."""
        return transmitted(motion, place.joint, shape[0], shape[1], 0.0)

    def admissible(self, shape: Shape, coefficients: FloatArray) -> bool:
        """The whole change, not a part of it (softer and stiffer shafts scale it)."""
        return bool(0.3 < coefficients[0] < 3.0)

    def plausible(
        self, shape: Shape, coefficients: FloatArray, torque: float, scale: JointScale
    ) -> bool:
        """Shafts down to the softest that are common."""
        inertia = float(scale.covered.inertia[scale.joint])
        stiffness = shape[0] / float(coefficients[0])
        return bool(stiffness >= inertia * (2.0 * np.pi * _SOFTEST) ** 2)

    def size_in_words(self, shape: Shape, coefficients: FloatArray, torque: float) -> str:
        """The stiffness alone: its torque depends on how the motion sets it swinging."""
        return f"stiffness {shape[0] / float(coefficients[0]):.2g} N m/rad"

    def parameters(
        self, shape: Shape, coefficients: FloatArray, deviations: FloatArray
    ) -> dict[str, EffectParameter]:
        """Stiffness and damping; the coefficient scales the compliance to first order."""
        stiffness = shape[0] / float(coefficients[0])
        return {
            "stiffness": number(stiffness, stiffness * deviations[0] / coefficients[0], "N m/rad"),
            "damping": number(shape[1], None, "N m s/rad"),
        }
