"""Inertia of a motor and its gear that differs from the nominal model."""

from collections.abc import Sequence

from idim_iv_ros.effects.cause import ParameterSpec
from idim_iv_ros.effects.parametric_effect import (
    Change,
    Estimated,
    ParameterSpace,
    ParametricEffect,
)


class DriveInertia(ParametricEffect):
    """Change of one drive's inertia on the joint side (grouped with the link's where it must).

    Where the configuration gives no armature, the nominal model lacks the inertia of every drive:
    that is one cause without a joint, with one number for each drive. The inertials of the URDF
    are taken as they are, since no torque separates a link about its own axis from its drive.
    """

    name = "drive_inertia"
    order = 50
    put_in_first = True
    part = "drive"
    confounders = ("link_inertia", "payload", "time_delay")
    excitation = "fast motion of this joint and of those it is coupled to"
    segments = ("multisine",)
    specs = (
        ParameterSpec(
            "change_of_drive_inertia", "kg m²", "change of the drive inertia", standard="Ia"
        ),
    )

    def places(self, space: ParameterSpace) -> list[int | None]:
        """Each joint, or none where no drive has an inertia."""
        return [None] if space.bare_drives else super().places(space)

    def variants(self, space: ParameterSpace, joint: int | None) -> list[list[Change]]:
        """One number; one for each drive where none has an inertia."""
        if joint is not None:
            return super().variants(space, joint)
        changes = [
            change
            for drive in sorted(space.bare_drives)
            for change in space.change("Ia", drive, space.model.robot.joints[drive])
        ]
        return [changes] if changes else []

    def known_to_be_left_out(self, space: ParameterSpace) -> bool:
        """Where no armature is given."""
        return bool(space.bare_drives)

    def inseparable_from(self, space: ParameterSpace) -> tuple[tuple[str, str], ...]:
        """Links of the joints whose drive has no base parameter of its own (ZZ1 + Ia1)."""
        joints, names = space.model.robot.joints, space.model.base.names
        grouped = [drive for drive in sorted(space.bare_drives) if f"Ia{drive + 1}" not in names]
        return tuple(("link_inertia", joints[drive]) for drive in grouped)

    def subject(self, place: str) -> str:
        """Of one drive, or of all."""
        if place:
            return super().subject(place)
        return "the drives have inertia that the nominal model lacks"

    def admissible(
        self, space: ParameterSpace, joint: int | None, estimates: Sequence[Estimated]
    ) -> bool:
        """The inertia does not become negative."""
        given = 0.0 if joint is None else float(space.model.robot.given.drive_inertia[joint])
        return not any(estimate.exceeds(-given) is False for estimate in estimates)
