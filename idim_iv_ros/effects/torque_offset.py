"""A constant torque that the nominal model does not have: of the sensor, the drive or a cable."""

from idim_iv_ros.effects.cause import ParameterSpec
from idim_iv_ros.effects.parametric_effect import Change, ParameterSpace, ParametricEffect


class TorqueOffset(ParametricEffect):
    """Recorded torque of one joint = that of the nominal model + offset."""

    name = "torque_offset"
    order = 35
    part = "constant torque"
    confounders = ("payload", "gravity_direction")
    excitation = "the whole range of the joint, slowly, in both directions"
    segments = ("range_sweep",)
    specs = (
        ParameterSpec(
            "offset", "N m", "constant torque beyond the nominal model's", standard="off"
        ),
    )

    def variants(self, space: ParameterSpace, joint: int | None) -> list[list[Change]]:
        """One number."""
        assert joint is not None
        changes = space.change("off", joint, "offset")
        return [changes] if changes else []

    def base_parameters(self, space: ParameterSpace, joint: int) -> list[Change]:
        """Its own."""
        return space.base("off", joint, "offset")
