"""The robot that is identified: a URDF whose other joints are locked."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from idim_iv_ros.errors import UsageError
from idim_iv_ros.model.parameters import DynamicParameters, JointType

FloatArray = NDArray[np.float64]

# URDF files write right angles with few digits (1.5708); within this they are taken as meant.
RIGHT_ANGLE_TOLERANCE = 1e-5


@dataclass(frozen=True)
class JointLimits:
    """Limits of the URDF, (n_joints,) each; infinite where it gives none.

    Position in rad or m, velocity in rad/s or m/s, effort in N m or N.
    """

    lower: FloatArray
    upper: FloatArray
    velocity: FloatArray
    effort: FloatArray


@dataclass(frozen=True)
class RobotModel:
    """Kinematic tree of the identified joints with the values that the URDF gives.

    Attributes
    ----------
    name : str
    joints : tuple of str
        In the order of the configuration; the columns of every array follow it.
    joint_types : tuple of str
        ``revolute`` or ``prismatic``.
    pinocchio : pinocchio.Model
        Reduced model: every other joint is locked at its neutral position.
    order : (n_joints,) int
        ``q_pinocchio = q[order]``: joint of the configuration at each place of the tree.
    limits : JointLimits
    given : DynamicParameters
        Inertials of the URDF, damping and friction of its ``<dynamics>``, zero drive inertia.
    """

    name: str
    joints: tuple[str, ...]
    joint_types: tuple[JointType, ...]
    pinocchio: pin.Model
    order: NDArray[np.int64]
    limits: JointLimits
    given: DynamicParameters

    @property
    def has_inertials(self) -> bool:
        """Whether the URDF gives any mass to the moving links."""
        return bool(np.any(self.given.inertial[:, 0] > 0.0))


def load_robot(
    urdf: str,
    joints: Sequence[str],
    *,
    gravity: Sequence[float] = (0.0, 0.0, -9.81),
    armature: Sequence[float] | None = None,
    couplings: Sequence[tuple[int, int]] = (),
    name: str | None = None,
    source: str = "robot_description",
) -> RobotModel:
    """Build the model of the identified joints from URDF text.

    Parameters
    ----------
    urdf
        The text of the URDF.
    joints
        Names of the identified joints; every other joint is locked at neutral.
    gravity
        (3,) m/s² in the base frame.
    armature
        (n_joints,) drive inertia of the given model, joint side, kg m².
    couplings
        Pairs of indices of joints that a transmission couples.
    source
        What to call the URDF in messages.

    Raises
    ------
    UsageError
        Not a URDF, a joint that it does not have, or one that is not revolute or prismatic.
    """
    root = _parse(urdf, source)
    elements = {element.get("name", ""): element for element in root.findall("joint")}
    types = tuple(_joint_type(elements, joint, source) for joint in joints)
    limits = _limits(elements, joints)
    _normalise(root)
    try:
        full = pin.buildModelFromXML(ElementTree.tostring(root, encoding="unicode"))
    except (ValueError, RuntimeError, IndexError) as error:
        reason = str(error).strip().splitlines()[0] if str(error).strip() else "no reason given"
        raise UsageError(f"{source}: not a usable URDF: {reason}") from error
    for joint in joints:
        if not full.existJointName(joint):
            raise UsageError(f"{source}: joint {joint} is not connected to the base link")
    kept = {full.getJointId(joint) for joint in joints}
    locked = [index for index in range(1, full.njoints) if index not in kept]
    model = pin.buildReducedModel(full, locked, pin.neutral(full))
    model.gravity.linear = np.asarray(gravity, dtype=float)
    order = np.array([list(joints).index(tree) for tree in model.names[1:]], dtype=np.int64)
    return RobotModel(
        name=name or root.get("name") or "robot",
        joints=tuple(joints),
        joint_types=types,
        pinocchio=model,
        order=order,
        limits=limits,
        given=_given(model, order, elements, joints, armature, couplings),
    )


def _parse(urdf: str, source: str) -> ElementTree.Element:
    try:
        root = ElementTree.fromstring(urdf)
    except ElementTree.ParseError as error:
        raise UsageError(f"{source}: not XML: {error}") from error
    if root.tag != "robot":
        raise UsageError(f"{source}: not a URDF: the root element is <{root.tag}>, not <robot>")
    return root


def _joint_type(elements: dict[str, ElementTree.Element], joint: str, source: str) -> JointType:
    if joint not in elements:
        movable = [name for name, e in elements.items() if e.get("type") != "fixed"]
        raise UsageError(
            f"{source}: no joint {joint} in this URDF; its movable joints: {', '.join(movable)}"
        )
    urdf_type = elements[joint].get("type")
    if urdf_type in ("revolute", "continuous"):
        return "revolute"
    if urdf_type == "prismatic":
        return "prismatic"
    raise UsageError(
        f"{source}: joint {joint} is {urdf_type}; only revolute, continuous and prismatic joints "
        "can be identified"
    )


def _limits(elements: dict[str, ElementTree.Element], joints: Sequence[str]) -> JointLimits:
    values = np.full((4, len(joints)), np.inf)
    values[0] = -np.inf
    for column, joint in enumerate(joints):
        limit = elements[joint].find("limit")
        if limit is None:
            continue
        keys = ["lower", "upper", "velocity", "effort"]
        if elements[joint].get("type") == "continuous":
            keys = keys[2:]
        for key in keys:
            text = limit.get(key)
            row = ("lower", "upper", "velocity", "effort").index(key)
            # URDF: lower and upper are 0 when left out.
            if text is not None:
                values[row, column] = float(text)
            elif key in ("lower", "upper"):
                values[row, column] = 0.0
    if np.any(values[0] >= values[1]):
        equal = values[0] >= values[1]
        values[0, equal], values[1, equal] = -np.inf, np.inf
    return JointLimits(*values)


def _normalise(root: ElementTree.Element) -> None:
    """Continuous joints become revolute (one coordinate each); rounded right angles are mended."""
    for joint in root.findall("joint"):
        if joint.get("type") == "continuous":
            joint.set("type", "revolute")
            limit = joint.find("limit")
            if limit is None:
                limit = ElementTree.SubElement(joint, "limit", effort="0", velocity="0")
            limit.set("lower", "-1e9")
            limit.set("upper", "1e9")
        origin = joint.find("origin")
        if origin is not None and origin.get("rpy"):
            angles = [_right_angle(float(angle)) for angle in origin.get("rpy", "").split()]
            origin.set("rpy", " ".join(repr(angle) for angle in angles))
    # Geometry names mesh files that need not exist here, and plays no part in the dynamics.
    for link in root.findall("link"):
        for tag in ("visual", "collision"):
            for element in link.findall(tag):
                link.remove(element)


def _right_angle(angle: float) -> float:
    nearest = round(angle / (math.pi / 2)) * (math.pi / 2)
    return nearest if abs(angle - nearest) < RIGHT_ANGLE_TOLERANCE else angle


def _given(
    model: pin.Model,
    order: NDArray[np.int64],
    elements: dict[str, ElementTree.Element],
    joints: Sequence[str],
    armature: Sequence[float] | None,
    couplings: Sequence[tuple[int, int]],
) -> DynamicParameters:
    n = len(joints)
    inertial = np.zeros((n, 10))
    for tree, joint in enumerate(order):
        inertial[joint] = model.inertias[tree + 1].toDynamicParameters()
    friction = np.zeros((2, n))
    for column, joint in enumerate(joints):
        dynamics = elements[joint].find("dynamics")
        if dynamics is not None:
            friction[0, column] = float(dynamics.get("damping", "0"))
            friction[1, column] = float(dynamics.get("friction", "0"))
    drive_inertia = np.zeros(n) if armature is None else np.asarray(armature, dtype=float)
    return DynamicParameters(
        inertial=inertial,
        drive_inertia=drive_inertia,
        viscous=friction[0],
        coulomb=friction[1],
        offset=np.zeros(n),
        coupling_joints=np.array(couplings, dtype=np.int64).reshape(-1, 2),
        coupling_inertia=np.array([drive_inertia[second] for _, second in couplings]),
        coupling_viscous=np.zeros(len(couplings)),
        coupling_coulomb=np.zeros(len(couplings)),
    )
