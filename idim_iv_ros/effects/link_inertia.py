"""A link whose mass, centre of mass or inertia differs from the nominal model."""

import re
from collections.abc import Sequence

from idim_iv_ros.effects.parametric_effect import (
    Change,
    Estimated,
    ParameterSpace,
    ParametricEffect,
    estimated,
)
from idim_iv_ros.model.parameters import INERTIAL, POINT

_POSITIVE = ("M", "XX", "YY", "ZZ")


class LinkInertia(ParametricEffect):
    """Changes of the inertial parameters of one link, those that the motion shows."""

    name = "link_inertia"
    order = 60
    part = "link"
    confounders = ("payload", "drive_inertia", "torque_gain")
    excitation = "all joints, fast and in many poses"
    segments = ("repeat", "multisine")

    def standard_kind(self, name: str) -> str:
        """Letters of the inertial parameter that changes; empty of one that groups others."""
        changed = re.fullmatch(r"change_of_([A-Z]+)\d+", name)
        return "" if changed is None else changed[1]

    def parameter_words(self, name: str) -> str:
        """Which of the link's parameters, and whether those of other links are grouped into it."""
        changed = re.fullmatch(r"change_of_(base_)?([A-Z]+\d+)", name)
        if changed is None:
            return super().parameter_words(name)
        return f"change of {changed[2]}{' (grouped)' if changed[1] else ''}"

    def variants(self, space: ParameterSpace, joint: int | None) -> list[list[Change]]:
        """Mass and first moments, as a payload may have nothing else, and all ten."""
        assert joint is not None
        variants = (
            [
                change
                for kind in kinds
                for change in space.change(kind, joint, f"change_of_{kind}{joint + 1}")
            ]
            for kinds in (POINT, INERTIAL)
        )
        return [changes for changes in variants if changes]

    def which(self, joint: int) -> str:
        """The number of the link that the joint moves, in words."""
        return f" (link {joint + 1})"

    def admissible(
        self, space: ParameterSpace, joint: int | None, estimates: Sequence[Estimated]
    ) -> bool:
        """Mass and moments of inertia stay positive where the URDF gives them."""
        assert joint is not None
        given = space.model.robot.given.of_bodies[joint]
        for kind in _POSITIVE:
            value = float(given[INERTIAL.index(kind)])
            estimate = estimated(estimates, f"change_of_{kind}{joint + 1}")
            if estimate is not None and value > 0.0 and estimate.exceeds(-value) is False:
                return False
        return True
