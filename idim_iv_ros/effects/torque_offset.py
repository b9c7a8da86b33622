"""A constant torque that the nominal model does not have: of the sensor, the drive or a cable."""

from idim_iv_ros.effects.cause import ParameterSpec
from idim_iv_ros.effects.parametric_effect import ParametricEffect


class TorqueOffset(ParametricEffect):
    """Recorded torque of one joint = that of the nominal model + offset."""

    name = "torque_offset"
    order = 35
    part = "offset"
    excitation = "the whole range of the joint, slowly, in both directions"
    segments = ("range_sweep",)
    specs = (
        ParameterSpec(
            "offset", "N m", "constant torque beyond the nominal model's", standard="off"
        ),
    )
