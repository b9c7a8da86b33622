"""A link whose mass, centre of mass or inertia differs from the nominal model."""

import re

import numpy as np

from idim_iv_ros.effects.parametric_effect import Change, ParameterSpace, ParametricEffect
from idim_iv_ros.model.parameters import INERTIAL, POINT, WHOLE_LINK

_HEAVIER = "relative_change_of_mass"


class LinkInertia(ParametricEffect):
    """Changes of the inertial parameters of one link, those that the motion shows.

    A link of another mass and the same shape is one number, which is tried first: another material,
    or a thicker wall, moves all ten parameters alike.
    """

    name = "link_inertia"
    order = 60
    part = "link"
    excitation = "all joints, fast and in many poses"
    segments = ("repeat", "multisine")
    sets = (POINT, INERTIAL)  # mass and first moments alone: a payload may have nothing else

    def variants(self, space: ParameterSpace, joint: int | None) -> list[list[Change]]:
        """The whole link heavier or lighter; then the `sets`."""
        assert joint is not None
        direction = np.zeros(space.size)
        for kind, value in zip(INERTIAL, space.model.robot.given.of_bodies[joint], strict=True):
            for change in space.change(kind, joint, kind):
                direction += value * change.direction
        whole = [[Change(_HEAVIER, "", direction, -1.0)]] if direction.any() else []
        return [*whole, *super().variants(space, joint)]

    def standard_kind(self, name: str) -> str:
        """Letters of the inertial parameter that changes; empty of one that groups others."""
        changed = re.fullmatch(r"change_of_([A-Z]+)\d+", name)
        return WHOLE_LINK if name == _HEAVIER else "" if changed is None else changed[1]

    def parameter_words(self, name: str) -> str:
        """Which of the link's parameters, and whether those of other links are grouped into it."""
        changed = re.fullmatch(r"change_of_(base_)?([A-Z]+\d+)", name)
        if changed is None:
            return super().parameter_words(name)
        return f"change of {changed[2]}{' (grouped)' if changed[1] else ''}"

    def change_of(self, kind: str, joint: int) -> str:
        """Name of the change of a link's parameter, with the number of the link."""
        return f"change_of_{kind}{joint + 1}"

    def which(self, joint: int) -> str:
        """The number of the link that the joint moves, in words."""
        return f" (link {joint + 1})"
