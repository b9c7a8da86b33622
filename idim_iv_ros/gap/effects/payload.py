"""A mass on the last link that the given model does not have."""

from collections.abc import Sequence

from idim_iv_ros.gap.effects.parametric_effect import (
    Change,
    Estimated,
    ParameterSpace,
    ParametricEffect,
    estimated,
)
from idim_iv_ros.model.parameters import INERTIAL

_POINT = ("M", "MX", "MY", "MZ")
_NAMES = {"M": "mass", "MX": "moment_x", "MY": "moment_y", "MZ": "moment_z"}


class Payload(ParametricEffect):
    """Mass, first moments and, where they are needed, moments of inertia, in the link's frame.

    Simulated with the base parameters, which hold it.
    """

    name = "payload"
    order = 10
    look_alikes = ("link_inertia", "torque_gain", "gravity_direction")
    excitation = "all joints, in poses that move the last link through all directions of gravity"

    def places(self, space: ParameterSpace) -> list[int | None]:
        """Links that carry no other."""
        robot = space.model.robot
        parents = [int(parent) for parent in robot.pinocchio.parents]
        return [int(joint) for tree, joint in enumerate(robot.order) if tree + 1 not in parents[1:]]

    def variants(self, space: ParameterSpace, joint: int | None) -> list[list[Change]]:
        """A mass that is small beside its distance, and any rigid body."""
        assert joint is not None
        point = [change for kind in _POINT for change in space.change(kind, joint, _NAMES[kind])]
        body = [
            change
            for kind in INERTIAL
            for change in space.change(kind, joint, _NAMES.get(kind, f"inertia_{kind.lower()}"))
        ]
        return [each for each in (point, body) if each]

    def admissible(
        self, space: ParameterSpace, joint: int | None, found: Sequence[Estimated]
    ) -> bool:
        """A payload weighs something, and has no negative moment of inertia.

        Where its weight is not determined beside other changes it is one of their combinations.
        """
        mass = estimated(found, "mass")
        if mass is not None and (not mass.determined or mass.value <= 0.0):
            return False
        moments = (estimated(found, f"inertia_{kind}") for kind in ("xx", "yy", "zz"))
        return not any(each is not None and each.clearly_negative for each in moments)
