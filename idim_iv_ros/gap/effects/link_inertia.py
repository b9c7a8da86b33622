"""A link whose mass, centre of mass or inertia is not as given."""

from collections.abc import Sequence

from idim_iv_ros.gap.effects.parametric_effect import (
    Change,
    Estimated,
    ParameterSpace,
    ParametricEffect,
    estimated,
)
from idim_iv_ros.model.parameters import INERTIAL, REGRESSOR_ORDER

_POSITIVE = ("M", "XX", "YY", "ZZ")


class LinkInertia(ParametricEffect):
    """Changes of the standard inertial parameters of one link, those that the motion shows.

    Simulated with the base parameters, which hold it.
    """

    name = "link_inertia"
    order = 60
    look_alikes = ("payload", "drive_inertia", "torque_gain")
    excitation = "all joints, fast and in many poses"

    def variants(self, space: ParameterSpace, joint: int | None) -> list[list[Change]]:
        """All ten."""
        assert joint is not None
        changes = [
            change
            for kind in INERTIAL
            for change in space.change(kind, joint, f"change_of_{kind}{joint + 1}")
        ]
        return [changes] if changes else []

    def admissible(
        self, space: ParameterSpace, joint: int | None, found: Sequence[Estimated]
    ) -> bool:
        """Mass and moments of inertia stay positive where the URDF gives them."""
        assert joint is not None
        given = space.model.robot.given.inertial[joint]
        for kind in _POSITIVE:
            value = float(given[REGRESSOR_ORDER[INERTIAL.index(kind)]])
            each = estimated(found, f"change_of_{kind}{joint + 1}")
            if each is not None and value > 0.0 and each.above(-value) is False:
                return False
        return True
