"""A mass on the last link that the nominal model does not have."""

from collections.abc import Mapping, Sequence

import numpy as np

from idim_iv_ros.effects.cause import ParameterSpec
from idim_iv_ros.effects.parametric_effect import (
    CLEARLY,
    Change,
    Estimated,
    ParameterSpace,
    ParametricEffect,
)
from idim_iv_ros.model import RobotModel
from idim_iv_ros.model.parameters import INERTIAL, POINT
from idim_iv_ros.types import FloatArray

_CHECKED = ("M", "XX", "YY", "ZZ")


class Payload(ParametricEffect):
    """Mass, first moments and, where they are needed, moments of inertia, in the link's frame."""

    name = "payload"
    order = 10
    part = "load"
    prior_weight = 4.0  # tools are changed, links are not
    excitation = "all joints, in poses that move the last link through all directions of gravity"
    segments = ("repeat",)
    sets = (POINT, INERTIAL)  # a point mass, and any rigid body
    specs = (
        ParameterSpec("mass", "kg", "mass", standard="M"),
        *(
            ParameterSpec(f"moment_{axis}", "kg m", words, standard=f"M{axis.upper()}")
            for axis in "xyz"
            for words in [f"mass times its {axis} in the link's frame"]
        ),
        *(
            ParameterSpec(f"inertia_{axes}", "kg m²", words, standard=axes.upper())
            for axes in ("xx", "xy", "xz", "yy", "yz", "zz")
            for words in [f"moment of inertia {axes} about the link's frame"]
        ),
    )

    def places(self, space: ParameterSpace) -> list[int | None]:
        """Joints whose links carry no further link."""
        robot = space.model.robot
        parents = [int(parent) for parent in robot.pinocchio.parents]
        return [int(joint) for tree, joint in enumerate(robot.order) if tree + 1 not in parents[1:]]

    def variants(self, space: ParameterSpace, joint: int | None) -> list[list[Change]]:
        """Those of the `sets`, and of them what a tool has that is centred on the last axis."""
        assert joint is not None
        variants = super().variants(space, joint)
        robot = space.model.robot
        moved = robot.pinocchio.joints[list(robot.order).index(joint) + 1]
        turns = np.abs(np.ravel(moved.createData().S)[3:])
        if turns.max() < 1.0:  # about no axis of the link's frame
            return variants
        axis = "xyz"[int(turns.argmax())]
        centred = {"mass", f"moment_{axis}", "inertia_xx", "inertia_yy", "inertia_zz"}
        of_tools = [[c for c in variant if c.name in centred] for variant in variants]
        return variants + [variant for variant in of_tools if variant]

    def admissible(
        self, space: ParameterSpace, joint: int | None, estimates: Sequence[Estimated]
    ) -> bool:
        """A payload weighs something, is near the flange and has the inertia of a rigid body.

        A negative one is a part that the model has and the robot has not: no more than is there,
        unless other recordings have it.
        """
        assert joint is not None
        named = {estimate.change.name: estimate for estimate in estimates}
        mass = named.get("mass")
        there, sign = np.zeros(len(INERTIAL)), 1.0
        if mass is not None and mass.value < 0.0:
            given = space.model.robot.given.of_bodies[joint]
            there, sign = np.full(len(INERTIAL), np.inf) if space.is_free else given, -1.0
        for kind in _CHECKED:
            change = named.get(_NAMES[kind])
            if change is not None and not change.may_exceed(-float(there[INERTIAL.index(kind)])):
                return False
        return _is_body(named, sign, _size(space.model.robot, joint))


_NAMES = {spec.standard: spec.name for spec in Payload.specs}


def _size(robot: RobotModel, joint: int) -> float:
    """How far a link's flange can be from the base, m; infinite where joints slide.

    The sum of the distances between joints, and twice that of the link's centre.
    """
    model = robot.pinocchio
    tree = list(robot.order).index(joint) + 1
    size = 2.0 * float(np.linalg.norm(np.asarray(model.inertias[tree].lever)))
    while tree > 0:
        if model.joints[tree].shortname().startswith("JointModelP"):
            return np.inf
        size += float(np.linalg.norm(np.asarray(model.jointPlacements[tree].translation)))
        tree = int(model.parents[tree])
    return size if size > 0.0 else np.inf


def _ends(named: Mapping[str, Estimated], names: Sequence[str], sign: float) -> FloatArray:
    """Least and largest value (2, k) of some numbers; infinite where they do not change."""
    ends = np.tile([[-np.inf], [np.inf]], len(names))
    for place, estimate in enumerate(map(named.get, names)):
        if estimate is not None:
            ends[:, place] = sign * estimate.value + CLEARLY * estimate.std * np.array([-1.0, 1.0])
    return ends


def _least_size(ends: FloatArray) -> FloatArray:
    """Smallest absolute values (k,) between ends (2, k)."""
    return np.asarray(np.maximum(np.maximum(ends[0], -ends[1]), 0.0))


def _is_body(named: Mapping[str, Estimated], sign: float, size: float) -> bool:
    """Whether numbers, within their intervals, may be a body of positive density near the flange.

    Its centre of mass lies within the `size` of the arm from its last joint. The pseudo-inertia
    [[Σ, h], [hᵀ, m]] (Wensing et al. 2018) of ten numbers then has no negative diagonal and no
    negative 2 × 2 minor about it; Σ = ½ tr(I) 1 − I.
    """
    mass = _ends(named, ("mass",), sign)[1, 0]
    moments = _least_size(_ends(named, [_NAMES[kind] for kind in POINT[1:]], sign))
    if float(np.linalg.norm(moments)) > size * mass:
        return False
    if not any(name.startswith("inertia_") for name in named):
        return True
    least, most = _ends(named, ("inertia_xx", "inertia_yy", "inertia_zz"), sign)
    across = _least_size(_ends(named, ("inertia_yz", "inertia_xz", "inertia_xy"), sign))
    second = np.array([most[(k + 1) % 3] + most[(k + 2) % 3] - least[k] for k in range(3)]) / 2.0
    if np.any(second < 0.0):
        return False
    # Of nothing known, a product is infinite, or not a number: nothing is excluded.
    products = np.roll(second, -1) * np.roll(second, -2)
    return not np.any(moments**2 > mass * second) and not np.any(across**2 > products)
