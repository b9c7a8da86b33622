"""Viscous friction that differs between the two directions."""

import numpy as np

from idim_iv_ros.compilation import kernel
from idim_iv_ros.effects.cause import ParameterSpec
from idim_iv_ros.effects.contribution import Instant, Torque, TorqueLaw
from idim_iv_ros.effects.effect import Place, Shape, ShareOf, StructuralEffect
from idim_iv_ros.effects.motion import RobotMotion, Torques
from idim_iv_ros.types import FloatArray


@kernel
def _torque(p: FloatArray, at: Instant, state: FloatArray) -> Torque:
    """Torque for the simulator from the parameters p = (offset, viscous)."""
    return Torque(0.0, at.direction * p[1], p[0], 0.0)


class AsymmetricFriction(StructuralEffect[Shape]):
    """viscous · |dq|: half the difference of viscous friction between the directions.

    Half the difference of dry friction is a constant torque, which the model has: it is a
    `torque_offset`, which no recording separates from it. The simulator has it as `offset`.
    """

    name = "asymmetric_friction"
    order = 30
    part = "friction"
    family = "velocity"
    linear = ("viscous",)
    signed = True
    excitation = "the same path in both directions, at several speeds and postures"
    segments = ("range_sweep", "plateau")
    typical = ShareOf("dry friction", 0.1)  # 5 to 20 %
    specs = (
        ParameterSpec("offset", "N m", "offset"),
        ParameterSpec(
            "viscous", "N m s/rad", "half of viscous friction forwards less that backwards"
        ),
    )
    laws = (TorqueLaw(_torque),)

    def columns(self, motion: RobotMotion, place: Place, shape: Shape) -> Torques:
        """Torque |dq| of a coefficient `viscous` of one."""
        return {place.joint: np.abs(motion.velocity[:, [place.joint]])}
