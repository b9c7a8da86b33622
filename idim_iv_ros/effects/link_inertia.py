"""A link whose mass, centre of mass or inertia differs from the nominal model."""

import re

from idim_iv_ros.effects.parametric_effect import ParametricEffect
from idim_iv_ros.model.parameters import INERTIAL, POINT


class LinkInertia(ParametricEffect):
    """Changes of the inertial parameters of one link, those that the motion shows."""

    name = "link_inertia"
    order = 60
    part = "link"
    excitation = "all joints, fast and in many poses"
    segments = ("repeat", "multisine")
    sets = (POINT, INERTIAL)  # mass and first moments alone: a payload may have nothing else

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

    def change_of(self, kind: str, joint: int) -> str:
        """Name of the change of a link's parameter, with the number of the link."""
        return f"change_of_{kind}{joint + 1}"

    def which(self, joint: int) -> str:
        """The number of the link that the joint moves, in words."""
        return f" (link {joint + 1})"
