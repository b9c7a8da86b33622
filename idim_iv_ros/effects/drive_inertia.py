"""Inertia of a motor and its gear that differs from the nominal model."""

from idim_iv_ros.effects.cause import ParameterSpec
from idim_iv_ros.effects.parametric_effect import ParameterSpace, ParametricEffect


class DriveInertia(ParametricEffect):
    """Change of one drive's inertia on the joint side (grouped with the link's where it must).

    Where the configuration gives no armature the inertials of the URDF are taken as they are, since
    no torque separates a link about its own axis from its drive.
    """

    name = "drive_inertia"
    order = 50
    part = "drive"
    excitation = "fast motion of this joint and of those it is coupled to"
    segments = ("multisine",)
    specs = (
        ParameterSpec(
            "change_of_drive_inertia", "kg m²", "change of the drive inertia", standard="Ia"
        ),
    )

    def inseparable_from(self, space: ParameterSpace, joint: int) -> tuple[str, ...]:
        """The link's inertia, where it shares its base parameter with the drive's (ZZ1 + Ia1)."""
        return () if f"Ia{joint + 1}" in space.model.base.names else ("link_inertia",)
