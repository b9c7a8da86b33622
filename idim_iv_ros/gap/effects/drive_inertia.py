"""Inertia of a motor and its gear that is not as given."""

from collections.abc import Sequence

from idim_iv_ros.gap.effects.parametric_effect import (
    Change,
    Estimated,
    ParameterSpace,
    ParametricEffect,
)


class DriveInertia(ParametricEffect):
    """Change of one drive's inertia on the joint side (grouped with the link's where it must).

    Simulated with the base parameters, which hold it.
    """

    name = "drive_inertia"
    order = 50
    look_alikes = ("link_inertia", "payload", "time_delay")
    excitation = "fast motion of this joint and of those it is coupled to"

    def variants(self, space: ParameterSpace, joint: int | None) -> list[list[Change]]:
        """One number."""
        assert joint is not None
        changes = space.change("Ia", joint, "change_of_drive_inertia")
        return [changes] if changes else []

    def base_parameters(self, space: ParameterSpace, joint: int) -> list[Change]:
        """Its own."""
        return space.base("Ia", joint, "change_of_drive_inertia")

    def admissible(
        self, space: ParameterSpace, joint: int | None, found: Sequence[Estimated]
    ) -> bool:
        """The inertia does not become negative."""
        assert joint is not None
        given = float(space.model.robot.given.drive_inertia[joint])
        return not any(each.above(-given) is False for each in found)
