"""A torque constant, gear ratio or effort scale that differs from the nominal model."""

from collections.abc import Sequence

from idim_iv_ros.compilation import kernel
from idim_iv_ros.effects.cause import Parameters, ParameterSpec
from idim_iv_ros.effects.contribution import DriveLaw
from idim_iv_ros.effects.parametric_effect import (
    Change,
    Estimated,
    ParameterSpace,
    ParametricEffect,
)
from idim_iv_ros.types import FloatArray


@kernel
def _curve(p: FloatArray, command: float) -> float:
    """Acting torque of a command from the parameter p = (factor)."""
    return float(p[0] * command)


class TorqueGain(ParametricEffect):
    """Actual torque = factor · recorded torque: the recording holds torque / factor."""

    name = "torque_gain"
    order = 30
    part = "torque scale"
    largest = 0.6  # of the recorded torque that is needed, more or less
    excitation = "a known load: gravity and inertia that the nominal model is right about"
    beyond_motion = "needs a known load: repeat the motion with a payload of known mass"
    specs = (ParameterSpec("factor", "", "actual torque over recorded torque", 1.0, "positive"),)
    in_base_parameters = False
    everywhere = True
    laws = (DriveLaw(_curve, rank=1),)

    def variants(self, space: ParameterSpace, joint: int | None) -> list[list[Change]]:
        """The gain of the recorded torque, by itself."""
        assert joint is not None
        return [[Change("recorded_more", "", space.gain(joint))]]

    def parameters(self, estimates: Sequence[Estimated]) -> Parameters:
        """The factor, from the share that the recorded torque is larger."""
        named: Parameters = {}
        for estimate in estimates:
            factor = 1.0 / (1.0 + estimate.value)
            named |= self.numbers(factor=(factor, estimate.std * factor**2))
        return named
