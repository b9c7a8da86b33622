"""A mass on the last link that the nominal model does not have."""

from collections.abc import Sequence

from idim_iv_ros.effects.cause import ParameterSpec
from idim_iv_ros.effects.parametric_effect import (
    Change,
    Estimated,
    ParameterSpace,
    ParametricEffect,
    estimated,
)
from idim_iv_ros.model.parameters import INERTIAL, REGRESSOR_ORDER

_POINT = ("M", "MX", "MY", "MZ")
_CHECKED = ("M", "XX", "YY", "ZZ")
_NAMES = {"M": "mass", "MX": "moment_x", "MY": "moment_y", "MZ": "moment_z"}


class Payload(ParametricEffect):
    """Mass, first moments and, where they are needed, moments of inertia, in the link's frame."""

    name = "payload"
    order = 10
    confounders = ("link_inertia", "torque_gain", "gravity_direction")
    excitation = "all joints, in poses that move the last link through all directions of gravity"
    segments = ("repeat",)
    specs = (
        ParameterSpec("mass", "kg", "mass"),
        *(
            ParameterSpec(f"moment_{axis}", "kg m", f"mass times its {axis} in the link's frame")
            for axis in "xyz"
        ),
        *(
            ParameterSpec(
                f"inertia_{axes}", "kg m²", f"moment of inertia {axes} about the link's frame"
            )
            for axes in ("xx", "xy", "xz", "yy", "yz", "zz")
        ),
    )

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
        """A payload weighs something and has no negative moment of inertia.

        A negative one is a part that the model has and the robot has not: no more than is there.
        """
        assert joint is not None
        mass = estimated(found, "mass")
        there = dict.fromkeys(_CHECKED, 0.0)
        if mass is not None and mass.determined and mass.value < 0.0:
            given = space.model.robot.given.inertial[joint][list(REGRESSOR_ORDER)]
            there = dict(zip(INERTIAL, map(float, given), strict=True))
        for kind in _CHECKED:
            name = "mass" if kind == "M" else f"inertia_{kind.lower()}"
            change = estimated(found, name)
            if change is not None and change.above(-there[kind]) is False:
                return False
        return True
