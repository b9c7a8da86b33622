"""A MuJoCo model of a robot with the parameters of a result, every number in full precision.

Its elements hold the effects that MuJoCo has exactly. The numbers of a joint (damping, stiffness)
and of a tendon over two joints are what the effect's own file says (`Cause.element`). Of the
control: a delay is that of a motor, a limit beyond which nothing more acts the range of its
command, and gains are those of the actuators where no lag and no feedforward is part of it. MuJoCo
has no element for a constant torque, and its DC motor has LuGre friction, another law than those of
the catalogue. All these stay with `Effects`.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import numpy as np
import pinocchio as pin

from idim_iv_ros.effects.registry import BY_NAME, part_of
from idim_iv_ros.errors import UsageError
from idim_iv_ros.model import RobotModel
from idim_iv_ros.model.urdf import Urdf
from idim_iv_ros.simulation import SimulatedEffect
from idim_iv_ros.simulator_files.file_text import comment, number_text, numbers_text
from idim_iv_ros.simulator_files.robot import Coupled, DriveLaw, ExportedRobot, JointValues
from idim_iv_ros.types import FloatArray


@dataclass
class NativeEffects:
    """What the elements of a MuJoCo model have beyond friction and drive inertia."""

    # damping, stiffness: Coefficients of ∣v∣v and v³, N m s²/rad², N m s³/rad³; of q, q², q³
    damping: dict[int, FloatArray] = field(default_factory=dict)
    stiffness: dict[int, FloatArray] = field(default_factory=dict)
    couplings: list[Coupled] = field(default_factory=list)
    # Names of the joints or tendons that hold an effect, by its name
    listed: dict[str, list[str]] = field(default_factory=dict)

    def take(self, effect: SimulatedEffect, robot: RobotModel) -> bool:
        """Hold an effect; False where MuJoCo has no element for it."""
        cause = BY_NAME[effect.effect]
        if not cause.element_of or effect.joint is None:
            return False
        joint = robot.joints.index(effect.joint)
        low, high = float(robot.limits.lower[joint]), float(robot.limits.upper[joint])
        element = cause.element(effect.parameters, low, high)
        if element is None:
            return False
        name = effect.joint
        for numbers, values in (
            (self.damping, element.damping),
            (self.stiffness, element.stiffness),
        ):
            if values:
                numbers[joint] = numbers.get(joint, np.zeros(len(values))) + values
        if element.tendon:
            if effect.other_joint is None:
                return False
            tendon = Coupled(joint, robot.joints.index(effect.other_joint), *element.tendon)
            self.couplings.append(tendon)
            name = tendon.name(robot.joints)
        self.listed.setdefault(effect.effect, []).append(name)
        return True


def native_effects(
    effects: Sequence[SimulatedEffect], robot: RobotModel, law: DriveLaw
) -> tuple[NativeEffects, tuple[SimulatedEffect, ...]]:
    """Return what the model has natively, and all effects, marked where they are in it."""
    native = NativeEffects()
    marked = tuple(
        replace(effect, native=_in_control(effect, law) or native.take(effect, robot))
        for effect in effects
    )
    return native, marked


def _in_control(effect: SimulatedEffect, law: DriveLaw) -> bool:
    """Whether motors or actuators hold an effect; see `law.drive_law`."""
    part = part_of(effect.effect)
    if part == "limit":
        return not effect.parameters.get("slope", 0.0)
    return part == "delay" or (part == "gains" and law.configured and not law.beyond)


_IMPEDANCE = 0.95  # largest of MuJoCo's default solimpfriction
_THICKNESS = 0.12  # of a drawn link, of its length


def inertial_of(body: pin.Inertia, anchor: FloatArray | None = None) -> dict[str, str]:
    """Attributes of an `<inertial>`; `anchor` (3,): of the body's frame in that of the joint, m."""
    return {
        "pos": numbers_text(body.lever + (0.0 if anchor is None else anchor)),
        "mass": number_text(body.mass),
        "fullinertia": numbers_text(body.inertia[(0, 1, 2, 0, 0, 1), (0, 1, 2, 1, 2, 2)]),
    }


def friction_solver(lead: float, step: float) -> dict[str, str]:
    """Attributes of a joint whose dry friction turns early (s), or as late as a step (s) lets it.

    Early: 1/b = d T / 2 with the time constant T and the impedance d of MuJoCo's documentation.
    """
    if lead > 0.0:
        return {"solreffriction": f"{max(2.0 * lead / _IMPEDANCE, 2.0 * step):.4g} 1"}
    return {"solreffriction": f"{2.0 * step:.4g} 1", "solimpfriction": "0.99 0.99"}


def mjcf_text(exported: ExportedRobot, native: NativeEffects, comments: Sequence[str]) -> str:
    """Return the model as text, with effects that its elements hold, and comments at the top.

    Locked joints and fixed links are part of the body that carries them. Actuators are proportional
    and derivative where these are the whole law; else motors, whose commands are torques.

    Raises UsageError: a coupled transmission whose drives have less inertia or damping than it
    takes from them.
    """
    robot, law = exported.robot, exported.law
    values = _behind_transmission(exported.drives, robot)
    model = _Model(robot, exported.urdf, values, law, native)
    root = Element("mujoco", model=robot.name)
    for line in comments:
        root.append(comment(line))
    SubElement(root, "compiler", angle="radian", autolimits="true", inertiafromgeom="false")
    SubElement(
        root,
        "option",
        timestep=_number(law.period),
        gravity=_numbers(exported.model.gravity),
        integrator="implicitfast",
    )
    model.add_custom(SubElement(root, "custom"))
    bodies = model.add_bodies(SubElement(root, "worldbody"))
    for name, (_, load) in exported.mounted.items():
        carrier = bodies[load.joint]
        carrier.append(comment(load.words))
        SubElement(SubElement(carrier, "body", name=name), "inertial", inertial_of(load.body))
    if couplings := [*values.couplings, *native.couplings]:
        model.add_tendons(SubElement(root, "tendon"), couplings)
    model.add_actuators(SubElement(root, "actuator"))
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode") + "\n"


def _behind_transmission(values: JointValues, robot: RobotModel) -> JointValues:
    """Take out of the joints what the tendons of coupled drives add to them."""
    armature, damping = values.armature.copy(), values.damping.copy()
    for coupling in values.couplings:
        for joint in (coupling.first, coupling.second):
            armature[joint] -= coupling.inertia
            damping[joint] -= coupling.damping
            # What is left of two numbers that are equal is rounding.
            armature[joint] = 0.0 if abs(armature[joint]) < 1e-12 else armature[joint]
            if armature[joint] < 0.0 or damping[joint] < 0.0:
                raise UsageError(
                    f"the coupled transmission takes more inertia or damping from "
                    f"{robot.joints[joint]} than this drive has: MuJoCo has no element for that"
                )
    return replace(values, armature=armature, damping=damping)


@dataclass(frozen=True)
class _Model:
    """What the elements of the model are made from."""

    robot: RobotModel
    urdf: Urdf
    values: JointValues
    law: DriveLaw
    native: NativeEffects

    def add_custom(self, custom: Element) -> None:
        """The law, for a loop that runs it itself, and the names of elements that are effects.

        Who reads the file as a nominal model leaves these effects out.
        """
        law, size = self.law, str(len(self.robot.joints))
        SubElement(custom, "text", name="control_law", data=law.words)
        for name, gains in (("kp", law.kp), ("kd", law.kd), ("ki", law.ki), ("delay", law.delay)):
            SubElement(custom, "numeric", name=name, size=size, data=_numbers(gains))
        SubElement(custom, "numeric", name="period", data=_number(law.period))
        for effect, names in self.native.listed.items():
            listed, kind = SubElement(custom, "tuple", name=effect), BY_NAME[effect].element_of
            for name in dict.fromkeys(names):
                SubElement(listed, "element", objtype=kind, objname=name)

    def add_bodies(self, world: Element) -> dict[str, Element]:
        """One body for each joint, in the order of the tree; returned by joint."""
        tree = self.robot.pinocchio
        bodies = [world]
        for index, joint in enumerate(self.robot.order, start=1):
            link = self.urdf.joints[self.robot.joints[joint]].child
            attributes = {"name": link, **_placement(tree.jointPlacements[index])}
            body = SubElement(bodies[int(tree.parents[index])], "body", attributes)
            SubElement(body, "inertial", inertial_of(self.values.bodies[joint]))
            SubElement(body, "joint", self._joint(int(joint)))
            SubElement(body, "geom", self._drawn(index, self.values.bodies[joint]))
            bodies.append(body)
        names = (self.robot.joints[joint] for joint in self.robot.order)
        return dict(zip(names, bodies[1:], strict=True))

    def _joint(self, joint: int) -> dict[str, str]:
        robot, values, native = self.robot, self.values, self.native
        axis = np.array(self.urdf.joints[robot.joints[joint]].axis)
        damping = [values.damping[joint], *native.damping.get(joint, ())]
        attributes = {
            "name": robot.joints[joint],
            "type": "hinge" if robot.joint_types[joint] == "revolute" else "slide",
            "axis": _numbers(axis / np.linalg.norm(axis)),
            "armature": number_text(values.armature[joint]),
            "damping": numbers_text(np.array(damping)),
            "frictionloss": number_text(values.friction[joint]),
        }
        if values.friction[joint] > 0.0:
            attributes |= friction_solver(float(values.lead[joint]), self.law.period)
        limits = [robot.limits.lower[joint], robot.limits.upper[joint]]
        if np.all(np.isfinite(limits)):
            attributes["range"] = _numbers(limits)
        if joint in native.stiffness:
            attributes["stiffness"] = _numbers(native.stiffness[joint])
        limit = self.law.limit[joint]
        if self.law.in_actuators and math.isfinite(limit):
            attributes["actuatorfrcrange"] = _numbers([-limit, limit])
        return attributes

    def _drawn(self, index: int, body: pin.Inertia) -> dict[str, str]:
        """Something to look at: it neither weighs nor touches anything."""
        tree = self.robot.pinocchio
        children = [k for k in range(1, tree.njoints) if int(tree.parents[k]) == index]
        end = 2.0 * body.lever
        if children:
            end = np.array(tree.jointPlacements[children[0]].translation)
        length = float(np.linalg.norm(end))
        shape = {"type": "sphere", "size": "0.03"}
        if length > 1e-3:
            size = _number(round(_THICKNESS * length, 4))
            shape = {"type": "capsule", "fromto": _numbers([0.0, 0.0, 0.0, *end]), "size": size}
        return shape | {"contype": "0", "conaffinity": "0", "group": "2", "mass": "0"}

    def add_tendons(self, element: Element, couplings: Sequence[Coupled]) -> None:
        """Fixed tendons of coupled drives, and of effects."""
        joints = self.robot.joints
        for coupling in couplings:
            tendon = SubElement(
                element,
                "fixed",
                name=coupling.name(joints),
                armature=_number(coupling.inertia),
                damping=_number(coupling.damping),
                frictionloss=_number(coupling.friction),
            )
            for joint, sign in ((coupling.first, 1.0), (coupling.second, coupling.direction)):
                SubElement(tendon, "joint", joint=joints[joint], coef=_number(sign))

    def add_actuators(self, element: Element) -> None:
        """The law at each joint, or a motor."""
        law, joints = self.law, self.robot.joints
        for joint, name in enumerate(joints):
            gain, kd = (law.kp[joint], law.kd[joint]) if law.in_actuators else (1.0, 0.0)
            attributes = {
                "name": name,
                "joint": name,
                "gainprm": _number(gain),
                "biastype": "affine",
                "biasprm": _numbers([0.0, -gain if law.in_actuators else 0.0, -kd]),
            }
            if not law.in_actuators and math.isfinite(law.limit[joint]):
                attributes["ctrlrange"] = _numbers([-law.limit[joint], law.limit[joint]])
            if law.delay[joint] > 0.0:  # no law with a delay is in the actuators
                samples = math.ceil(law.delay[joint] / law.period - 1e-9) + 1
                attributes |= {"delay": _number(law.delay[joint]), "nsample": str(samples)}
            SubElement(element, "general", attributes)
        if law.in_actuators and law.velocity_reference:
            for name, gain in zip(joints, law.kd, strict=True):
                attributes = {"name": f"{name}_velocity", "joint": name, "gainprm": _number(gain)}
                SubElement(element, "general", attributes)


def _placement(place: pin.SE3) -> dict[str, str]:
    quaternion = pin.Quaternion(place.rotation)
    quaternion.normalize()
    parts = [quaternion.w, quaternion.x, quaternion.y, quaternion.z]
    return {"pos": _numbers(np.array(place.translation)), "quat": _numbers(parts)}


def _number(value: float) -> str:
    return repr(float(value) + 0.0)


def _numbers(values: Sequence[float] | FloatArray) -> str:
    return " ".join(_number(value) for value in values)
