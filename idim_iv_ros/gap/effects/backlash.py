"""Play between motor and link."""

import numpy as np
from scipy.ndimage import gaussian_filter1d

from idim_iv_ros.gap.effects.effect import Effect, Extent, FloatArray, Place, Shape, number
from idim_iv_ros.gap.result import EffectParameter
from idim_iv_ros.gap.smooth_motion import SmoothMotion


class Backlash(Effect):
    """The link is half the gap behind the motor on the side from which it is pushed.

    The flanks change where the torque of the links changes its sign, over a time that the shape
    gives in seconds. Moves the torques of all joints.
    """

    name = "backlash"
    family = "load"
    look_alikes = ("elasticity", "presliding")
    excitation = "slow motion through postures where the load changes its sign"
    unit = "rad"

    def grid(self, place: Place, extent: Extent) -> list[Shape]:
        """Times of a change from 10 to 80 ms, with damping (a tenth of the load) or without."""
        return [(0.01,), (0.02,), (0.04,), (0.08,)]

    def columns(self, motion: SmoothMotion, place: Place, shape: Shape) -> dict[int, FloatArray]:
        """See the class."""
        load = motion.load[:, place.joint]
        side = gaussian_filter1d(np.sign(load), shape[0] * motion.rate)
        small = 1e-4
        change = motion.moved(place.joint, -0.5 * small * side, links=True) / small
        return {joint: change[:, [joint]] for joint in range(change.shape[1])}

    def parameters(
        self, shape: Shape, coefficients: FloatArray, deviations: FloatArray
    ) -> dict[str, EffectParameter]:
        """The gap."""
        return {"gap": number(coefficients[0], deviations[0], "rad")}
