"""A link whose mass, centre of mass or inertia differs from the nominal model."""

import re
from collections.abc import Sequence

import numpy as np

from idim_iv_ros.effects.parametric_effect import (
    Change,
    Estimated,
    ParameterSpace,
    ParametricEffect,
)
from idim_iv_ros.model.parameters import (
    CENTRE_OF_MASS,
    INERTIAL,
    POINT,
    WHOLE_LINK,
    with_centre_moved,
)
from idim_iv_ros.types import FloatArray

_HEAVIER = "relative_change_of_mass"
_MOVED = "shift_of_centre_of_mass_along_"


class LinkInertia(ParametricEffect):
    """Changes of the inertial parameters of one link, those that the motion shows.

    A link of another mass and the same shape is one number, which is tried first: another material,
    or a thicker wall, moves all ten parameters alike. A centre of mass at another place is three.
    """

    name = "link_inertia"
    order = 60
    part = "link"
    excitation = "all joints, fast and in many poses"
    segments = ("repeat", "multisine")
    sets = (POINT, INERTIAL)  # mass and first moments alone: a payload may have nothing else

    def variants(self, space: ParameterSpace, joint: int | None) -> list[list[Change]]:
        """The whole link heavier or lighter; its centre of mass elsewhere; then the `sets`."""
        assert joint is not None
        given = np.array(space.model.robot.given.of_bodies[joint])
        # Half the difference of two unit shifts: moments of inertia are quadratic in them.
        shifts = [with_centre_moved(given, shift) for shift in np.vstack([np.eye(3), -np.eye(3)])]
        moved = [
            Change(_MOVED + axis, "m", _direction(space, joint, 0.5 * (there - back)))
            for axis, there, back in zip("xyz", shifts[:3], shifts[3:], strict=True)
        ]
        whole = [Change(_HEAVIER, "", _direction(space, joint, given), -1.0)]
        shown = [[one for one in changes if one.direction.any()] for changes in (whole, moved)]
        return [*filter(None, shown), *super().variants(space, joint)]

    def admissible(
        self, space: ParameterSpace, joint: int | None, estimates: Sequence[Estimated]
    ) -> bool:
        """No centre of mass moves by more than the radius of gyration, where it is linear."""
        assert joint is not None
        link = space.model.robot.given.of_bodies[joint]
        moments, mass = float(link[0] + link[3] + link[5]), float(link[9])
        shifts = [one.value for one in estimates if one.change.name.startswith(_MOVED)]
        far = mass * float(np.square(shifts).sum()) > 0.5 * moments
        return not far and super().admissible(space, joint, estimates)

    def standard_kind(self, name: str) -> str:
        """Letters of the inertial parameter that changes; empty of one that groups others."""
        changed = re.fullmatch(r"change_of_([A-Z]+)\d+", name)
        if name.startswith(_MOVED):
            return CENTRE_OF_MASS["xyz".index(name[-1])]
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


def _direction(space: ParameterSpace, joint: int, parameters: FloatArray) -> FloatArray:
    """Direction (d,) of a change of a link's XX … M (10,); zero where no motion shows it."""
    direction = np.zeros(space.size)
    for kind, value in zip(INERTIAL, parameters.tolist(), strict=True):
        for change in space.change(kind, joint, kind):
            direction += value * change.direction
    return direction
