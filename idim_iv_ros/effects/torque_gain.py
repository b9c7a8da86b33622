"""A torque constant, gear ratio or effort scale that is not as given."""

from collections.abc import Sequence

from idim_iv_ros.diagnosis.result import EffectParameter
from idim_iv_ros.effects.parametric_effect import (
    Change,
    Estimated,
    ParameterSpace,
    ParametricEffect,
)

_LARGEST = 0.6  # of the recorded torque that is needed, more or less


class TorqueGain(ParametricEffect):
    """Actual torque = factor · recorded torque: the recording holds torque / factor.

    Simulated by `simulation.effect_kernel.acting_torque`.
    """

    name = "torque_gain"
    order = 30
    confounders = ("payload", "link_inertia", "friction_level")
    excitation = "a known load: gravity and inertia that the nominal model is right about"

    def variants(self, space: ParameterSpace, joint: int | None) -> list[list[Change]]:
        """One number."""
        assert joint is not None
        return [[Change("recorded_more", "", space.gain(joint))]]

    def admissible(
        self, space: ParameterSpace, joint: int | None, found: Sequence[Estimated]
    ) -> bool:
        """No change that would be a wrong sign or unit."""
        return all(abs(each.value) <= _LARGEST for each in found)

    def parameters(
        self, space: ParameterSpace, joint: int | None, found: Sequence[Estimated]
    ) -> dict[str, EffectParameter]:
        """The factor, from the share that the recorded torque is larger."""
        named = {}
        for each in found:
            if each.std is not None:
                factor = 1.0 / (1.0 + each.value)
                named["factor"] = EffectParameter(factor, each.std * factor**2, "")
        return named
