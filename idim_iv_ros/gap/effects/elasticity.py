"""A shaft that twists between motor and link."""

import numpy as np
from scipy.signal import savgol_filter

from idim_iv_ros.gap.effects.effect import Effect, Extent, FloatArray, Place, Shape, number
from idim_iv_ros.gap.result import EffectParameter
from idim_iv_ros.gap.smooth_motion import SmoothMotion


class Elasticity(Effect):
    """The link lags behind the motor by τ / stiffness, τ the torque of the links behind it.

    To first order in the compliance; what was measured is the motor's position. Moves the
    torques of all joints. Shape: none (1).
    """

    name = "elasticity"
    family = "frequency"
    look_alikes = ("time_delay", "backlash")
    excitation = "a sweep to twice the resonance, small amplitude"
    unit = "rad/(N m)"

    def grid(self, place: Place, extent: Extent) -> list[Shape]:
        """One."""
        return [(1.0,), (0.6,)]

    def neighbours(self, shape: Shape, step: float, extent: Extent) -> list[Shape]:
        """None."""
        return []

    def free_numbers(self, shape: Shape) -> int:
        """See the grid."""
        return 1

    def columns(self, motion: SmoothMotion, place: Place, shape: Shape) -> dict[int, FloatArray]:
        """See the class."""
        load = motion.load[:, place.joint]
        scale = float(np.std(load)) or 1.0
        twist = np.sign(load) * scale * (np.abs(load) / scale) ** shape[0]
        if shape[0] != 1.0:
            twist = savgol_filter(twist, 7, 3)
        small = 1e-4 / max(float(np.max(np.abs(twist))), 1e-12)
        change = motion.moved(place.joint, -small * twist, links=True) / small
        return {joint: change[:, [joint]] for joint in range(change.shape[1])}

    def parameters(
        self, shape: Shape, coefficients: FloatArray, deviations: FloatArray
    ) -> dict[str, EffectParameter]:
        """Stiffness, by the inverse of the compliance."""
        compliance = max(float(coefficients[0]), 1e-12)
        stiffness = 1.0 / compliance
        return {"stiffness": number(stiffness, deviations[0] * stiffness**2, "N m/rad")}
