"""The robot that is identified: a URDF whose other joints are locked."""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from idim_iv_ros.errors import UsageError
from idim_iv_ros.model.mjcf import joint_motion
from idim_iv_ros.model.parameters import DynamicParameters, JointType
from idim_iv_ros.model.urdf import (
    MOVABLE,
    Urdf,
    judge_urdf,
    quoted,
    read_urdf_text,
    refuse,
)
from idim_iv_ros.types import FloatArray, IntArray

_DIGITS = 9  # of lengths in m and of directions; what is rounded beyond is the same robot
_NO_LIMIT = 1e9  # rad, rad/s, N m (m, m/s, N): a limit as large stands for none


@dataclass(frozen=True)
class JointLimits:
    """Limits of the URDF, (n_joints,) each; infinite where it gives none."""

    lower: FloatArray  # rad (m)
    upper: FloatArray  # rad (m)
    velocity: FloatArray  # rad/s (m/s)
    effort: FloatArray  # N m (N)


@dataclass(frozen=True)
class RobotModel:
    """Kinematic tree of the identified joints with the values that the URDF gives."""

    name: str
    joints: tuple[str, ...]  # In the order of the configuration, which every array has
    joint_types: tuple[JointType, ...]
    pinocchio: pin.Model  # Reduced: every other joint is locked at its neutral position
    order: IntArray  # (n_joints,): joint at a place of the tree: ``q_pinocchio = q[order]``
    limits: JointLimits
    # Inertials of the URDF, damping and friction of its ``<dynamics>``, drive inertia as given
    given: DynamicParameters
    doubts: tuple[str, ...] = ()  # What of the URDF is possible but hard to believe, in sentences
    armature_given: bool = False  # Whether anything says what inertia the drives have
    carriers: tuple[str, ...] = ()  # Locked joints that carry identified ones

    @property
    def gravity(self) -> FloatArray:
        """(3,) m/s² in the base frame."""
        return np.array(self.pinocchio.gravity.linear)

    def with_gravity(self, gravity: FloatArray) -> "RobotModel":
        """Return the robot under another gravity (3,), m/s²."""
        model = self.pinocchio.copy()
        model.gravity.linear = gravity
        return replace(self, pinocchio=model)

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

    - `joints`: names of the identified joints; every other joint is locked at neutral
    - `gravity`: (3,) m/s² in the base frame
    - `armature`: (n_joints,) drive inertia of the nominal model, joint side, kg m²; None: that of
      an MJCF
    - `couplings`: pairs of indices of joints that a transmission couples
    - `source`: what to call the URDF in messages

    Raises UsageError: not a URDF, a joint that it does not have or that is not revolute or
    prismatic, or links and joints that no robot can have (`judge_urdf`).
    """
    description = read_urdf_text(urdf, source)
    types = tuple(_joint_type(description, joint, source) for joint in joints)
    impossible, doubts = judge_urdf(description, joints)
    refuse(source, impossible)
    doubts = [*description.notes, *_locked_doubts(description, joints), *doubts]
    model, tree = _kinematic_tree(description, joints)
    model.gravity.linear = np.asarray(gravity, dtype=float)
    elements = [description.joints[joint] for joint in joints]
    limits = np.tile([[-np.inf], [np.inf], [np.inf], [np.inf]], len(elements))
    for joint, column in zip(elements, limits.T, strict=True):
        # URDF: lower and upper are 0 when left out.
        lower, upper = joint.limits.get("lower", 0.0), joint.limits.get("upper", 0.0)
        if joint.type != "continuous" and lower < upper:
            column[:2] = lower, upper
        column[2:] = [joint.limits.get(key, np.inf) for key in ("velocity", "effort")]
    limits[np.abs(limits) >= _NO_LIMIT] *= np.inf
    given = DynamicParameters.zero(len(joints), couplings)
    order = np.array([list(joints).index(joint) for joint in tree], dtype=np.int64)
    given.inertial[order] = [body.toDynamicParameters() for body in model.inertias[1:]]
    given.drive_inertia[:] = [j.armature for j in elements] if armature is None else armature
    given.coupling_inertia[:] = given.drive_inertia[given.coupling_joints[:, 1]]
    given.viscous[:] = [joint.damping for joint in elements]
    given.coulomb[:] = [joint.friction for joint in elements]
    carrier_of = {joint.child: joint for joint in description.joints.values()}
    carriers: list[str] = []
    for carried in elements:
        carrier = carrier_of.get(carried.parent)
        while carrier is not None:
            if carrier.type in MOVABLE and carrier.name not in (*joints, *carriers):
                carriers.append(carrier.name)
            carrier = carrier_of.get(carrier.parent)
    return RobotModel(
        name=name or description.name or "robot",
        joints=tuple(joints),
        joint_types=types,
        pinocchio=model,
        order=order,
        limits=JointLimits(*limits),
        given=given,
        doubts=tuple(f"{source}: {doubt}" for doubt in doubts),
        armature_given=armature is not None or description.from_mjcf,
        carriers=tuple(carriers),
    )


def _joint_type(urdf: Urdf, name: str, source: str) -> JointType:
    joint, shown = urdf.joints.get(name), quoted(name)
    if joint is None:
        movable = ", ".join(quoted(j.name) for j in urdf.joints.values() if j.type in MOVABLE)
        words = f"its movable joints: {movable}" if movable else "it has no movable one"
        raise UsageError(f"{source}: no joint {shown} in this URDF; {words}")
    if joint.tied:
        raise UsageError(
            f"{source}: joint {shown} is {joint.tied}; only hinges and slides that nothing ties "
            "can be identified: leave it out of robot.joints"
        )
    if joint.beyond:
        raise UsageError(
            f"{source}: joint {shown} has {joint.beyond}, which the nominal model has no term "
            "for: take it out of the file; diagnose finds such effects"
        )
    if joint.type not in MOVABLE:
        raise UsageError(
            f"{source}: joint {shown} is {joint.type}; only revolute, continuous and prismatic "
            "joints can be identified"
        )
    return "prismatic" if joint.type == "prismatic" else "revolute"


def _locked_doubts(urdf: Urdf, joints: Sequence[str]) -> list[str]:
    """Say where the joints of an MJCF stay that are not identified, if it is not at zero.

    Joints of a URDF that follow others are parts of grippers, and say nothing.
    """
    sentences = []
    for name, joint in urdf.joints.items():
        if name in joints or not (joint.rest or (joint.tied and urdf.from_mjcf)):
            continue
        unit = "m" if joint.type == "prismatic" else "rad"
        place = "at its reference" if joint.type == "floating" else f"at {joint.rest:.4g} {unit}"
        why = f" ({joint.tied})" if joint.tied else ""
        sentences.append(f"joint {quoted(name)}{why} is locked {place}")
    return sentences


def _kinematic_tree(urdf: Urdf, joints: Sequence[str]) -> tuple[pin.Model, list[str]]:
    """Build the tree of the identified joints; every other joint is fixed where it is at zero.

    Links and joints are never looked up by name, since a link and a joint may share theirs.

    Returns the model and the names of its joints in the order of the tree.
    """
    model, tree = pin.Model(), []
    # Of each link: the identified joint that carries it, and its placement in that joint's frame.
    places: dict[str, tuple[int, pin.SE3]] = {}
    for link, joint in urdf.outward():
        carrier, place = (0, pin.SE3.Identity()) if joint is None else places[joint.parent]
        if joint is not None:
            place = place * joint.placement
            kind = pin.FrameType.OP_FRAME
            if joint.name in joints:
                axis = joint.axis / np.linalg.norm(joint.axis)
                moved = pin.JointModelRevoluteUnaligned(axis)
                if joint.type == "prismatic":
                    moved = pin.JointModelPrismaticUnaligned(axis)
                carrier = model.addJoint(carrier, moved, place, joint.name)
                tree.append(joint.name)
                place, kind = pin.SE3.Identity(), pin.FrameType.JOINT
            elif joint.rest != 0.0 and joint.type in MOVABLE:
                place = place * joint_motion(joint.type, joint.axis, joint.rest)
            model.addFrame(pin.Frame(joint.name, carrier, place, kind))
        places[link] = carrier, place
        model.addFrame(pin.Frame(link, carrier, place, pin.FrameType.BODY))
        inertial = urdf.links[link]
        if inertial is not None and carrier > 0:
            body = pin.Inertia(inertial.mass, inertial.centre, inertial.inertia)
            model.appendBodyToJoint(carrier, body, place)
    return model, tree


def kinematics_digest(robot: RobotModel) -> str:
    """SHA-256 of joints, their types, their order in the tree, placements and axes."""
    model = robot.pinocchio
    parts = [*robot.joints, *robot.joint_types, *map(str, robot.order), *map(str, model.parents)]
    for place, joint in zip(model.jointPlacements[1:], model.joints[1:], strict=True):
        numbers = np.concatenate([place.homogeneous[:3].ravel(), np.ravel(joint.createData().S)])
        # Adding zero: no negative zeros.
        parts += [f"{number:.{_DIGITS}f}" for number in np.round(numbers, _DIGITS) + 0.0]
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()
