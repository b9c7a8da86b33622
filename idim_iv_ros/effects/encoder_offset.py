"""An encoder whose zero is not that of the model."""

import numpy as np

from idim_iv_ros.compilation import kernel
from idim_iv_ros.effects.cause import ParameterSpec
from idim_iv_ros.effects.contribution import EncoderLaw
from idim_iv_ros.effects.effect import Place, Shape, StructuralEffect
from idim_iv_ros.effects.motion import RobotMotion, Torques
from idim_iv_ros.types import FloatArray

_MOST = 0.2  # rad: the torque is linear in the offset for less


@kernel
def _error(p: FloatArray, q: float) -> tuple[float, float]:
    """Error of the encoder, p = (offset,), and its slope over the position."""
    return p[0], 0.0


class EncoderOffset(StructuralEffect[Shape]):
    """q_measured = q + offset: all links behind the joint are turned against the model."""

    name = "encoder_offset"
    order = 135
    family = "position"
    typical = 0.01  # rad, of 1 to 50 mrad
    linear = ("offset",)
    excitation = "slow motion through the whole range of all joints"
    segments = ("range_sweep",)
    specs = (ParameterSpec("offset", "rad", "measured position less that of the model"),)
    laws = (EncoderLaw(_error),)

    def columns(self, motion: RobotMotion, place: Place, shape: Shape) -> Torques:
        """Change of all torques by an offset, 1 rad large."""
        small = 1e-4
        shift = np.full(len(motion.position), -small)
        table = motion.moved(place.joint, shift, links=False) / small
        return {joint: table[:, [joint]] for joint in range(table.shape[1])}

    def admissible(self, shape: Shape, coefficients: FloatArray) -> bool:
        """Whether the offset is one that calibration leaves."""
        return abs(float(coefficients[0])) < _MOST
