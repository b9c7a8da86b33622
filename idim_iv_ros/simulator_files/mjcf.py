"""MuJoCo model of a robot with the parameters of a result, every number in full precision.

Effects that MuJoCo has exactly are in its elements: as damping or stiffness of a joint, or a tendon
over two joints (`Cause.element`). Of the control law, a delay is that of a motor, a limit is the
range of its command, and gains are those of the actuators if there is no lag and no feedforward.
MuJoCo has no element for a constant torque, and its DC motor has LuGre friction, another law than
those of the catalogue. All other effects are left to `Effects`.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np
import pinocchio as pin

from idim_iv_ros.effects.registry import BY_NAME, part_of
from idim_iv_ros.errors import UsageError
from idim_iv_ros.model import RobotModel
from idim_iv_ros.model.mjcf import element
from idim_iv_ros.model.parameters import body_of
from idim_iv_ros.simulation import SimulatedEffect
from idim_iv_ros.simulator_files.robot import Coupled, DriveLaw, ExportedRobot, JointValues
from idim_iv_ros.types import FloatArray


@dataclass
class NativeEffects:
    """Effects in the elements of a MuJoCo model, beyond friction and drive inertia."""

    # Coefficients of ∣v∣v and v³, N m s²/rad², N m s³/rad³
    damping: dict[int, FloatArray] = field(default_factory=dict)
    stiffness: dict[int, FloatArray] = field(default_factory=dict)  # of q, q², q³
    couplings: list[Coupled] = field(default_factory=list)
    # Names of the joints or tendons that hold an effect, by its name
    listed: dict[str, list[str]] = field(default_factory=dict)

    def take(self, effect: SimulatedEffect, robot: RobotModel) -> bool:
        """Add an effect to the elements; return False where MuJoCo has none for it."""
        if effect.joint is None:
            return False
        name, joint = effect.joint, robot.joints.index(effect.joint)
        low, high = float(robot.limits.lower[joint]), float(robot.limits.upper[joint])
        native = BY_NAME[effect.effect].element(effect.parameters, low, high)
        if native is None or (native.tendon and effect.other_joint is None):
            return False
        for numbers, values in ((self.damping, native.damping), (self.stiffness, native.stiffness)):
            if values:
                numbers[joint] = numbers.get(joint, 0.0) + np.array(values)
        if native.tendon and effect.other_joint is not None:
            other = robot.joints.index(effect.other_joint)
            self.couplings.append(Coupled(joint, other, *native.tendon))
            name = self.couplings[-1].name(robot.joints)
        self.listed.setdefault(effect.effect, []).append(name)
        return True


def native_effects(
    effects: Sequence[SimulatedEffect], robot: RobotModel, law: DriveLaw
) -> tuple[NativeEffects, tuple[SimulatedEffect, ...]]:
    """Return the native effects of the model, and all effects, with the native ones marked."""
    native = NativeEffects()
    marked = tuple(
        replace(effect, native=_in_control(effect, law) or native.take(effect, robot))
        for effect in effects
    )
    return native, marked


def _in_control(effect: SimulatedEffect, law: DriveLaw) -> bool:
    part = part_of(effect.effect)
    if part == "limit":
        return not effect.parameters.get("slope", 0.0)
    return part == "delay" or (part == "gains" and law.configured and not law.beyond)


_IMPEDANCE = 0.95  # largest of MuJoCo's default solimpfriction
_THICKNESS = 0.12  # of a drawn link, of its length


def inertial_of(body: pin.Inertia, anchor: FloatArray | None = None) -> dict[str, str]:
    """Return attributes of an `<inertial>`; `anchor` (3,): the body's frame in the joint's, m."""
    return {
        "pos": numbers_text(body.lever + (0.0 if anchor is None else anchor)),
        "mass": number_text(body.mass),
        "fullinertia": numbers_text(body.inertia[(0, 1, 2, 0, 0, 1), (0, 1, 2, 1, 2, 2)]),
    }


def friction_solver(lead: float, step: float) -> dict[str, str]:
    """Return solver attributes for friction that turns `lead` s early, or within two steps.

    Early: 1/b = d T / 2 with the time constant T and the impedance d of MuJoCo's documentation.
    """
    if lead > 0.0:
        return {"solreffriction": f"{max(2.0 * lead / _IMPEDANCE, 2.0 * step):.4g} 1"}
    return {"solreffriction": f"{2.0 * step:.4g} 1", "solimpfriction": "0.99 0.99"}


def mjcf_text(exported: ExportedRobot, native: NativeEffects, comments: Sequence[str]) -> str:
    """Return the model as text, with effects that its elements hold, and comments at the top.

    Locked joints and fixed links are part of the body that carries them. Proportional and
    derivative actuators are used if they express the whole law, else motors.

    Raises UsageError: drives of a coupled transmission with less inertia or damping than it needs.
    """
    robot, law = exported.robot, exported.law
    values = _without_tendons(exported.drives, robot)
    tendons = []
    for coupling in (*values.couplings, *native.couplings):
        ends = ((coupling.first, 1.0), (coupling.second, coupling.direction))
        tendon = element(
            "fixed",
            *(element("joint", joint=robot.joints[k], coef=_exact(sign)) for k, sign in ends),
            name=coupling.name(robot.joints),
            armature=_exact(coupling.inertia),
            damping=_exact(coupling.damping),
            frictionloss=_exact(coupling.friction),
        )
        tendons.append(tendon)
    root = element(
        "mujoco",
        *map(comment, comments),
        element("compiler", angle="radian", autolimits="true", inertiafromgeom="false"),
        element(
            "option",
            timestep=_exact(law.period),
            gravity=_exact(*exported.model.gravity),
            integrator="implicitfast",
        ),
        element("custom", *_custom(law, native)),
        _world(exported, values, native),
        *([element("tendon", *tendons)] if tendons else []),
        element("actuator", *_actuators(law, robot.joints)),
        model=robot.name,
    )
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode") + "\n"


def _without_tendons(values: JointValues, robot: RobotModel) -> JointValues:
    """Subtract from the joints what the tendons of coupled drives add to them."""
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


def _custom(law: DriveLaw, native: NativeEffects) -> Iterator[Element]:
    """Return custom elements: the law for an external loop, and the names of effect elements.

    A reader of the file as a nominal model leaves these effects out.
    """
    yield element("text", name="control_law", data=law.words)
    for name, gains in (("kp", law.kp), ("kd", law.kd), ("ki", law.ki), ("delay", law.delay)):
        yield element("numeric", name=name, size=str(len(gains)), data=_exact(*gains))
    yield element("numeric", name="period", data=_exact(law.period))
    for effect, names in native.listed.items():
        kind = BY_NAME[effect].element_of
        listed = (element("element", objtype=kind, objname=name) for name in dict.fromkeys(names))
        yield element("tuple", *listed, name=effect)


def _world(exported: ExportedRobot, values: JointValues, native: NativeEffects) -> Element:
    """Return one body for each joint, in the order of the tree, and one for each payload."""
    robot, tree = exported.robot, exported.robot.pinocchio
    bodies, carriers = [element("worldbody")], {}
    for index, joint in enumerate(robot.order, start=1):
        name = robot.joints[joint]
        carried = body_of(exported.bodies[name])
        body = element(
            "body",
            element("inertial", **inertial_of(carried)),
            element("joint", **_joint(exported, values, native, int(joint))),
            element("geom", **_visual_geom(tree, index, carried)),
            name=exported.urdf.joints[name].child,
            **_placement(tree.jointPlacements[index]),
        )
        bodies[int(tree.parents[index])].append(body)
        bodies.append(body)
        carriers[name] = body
    for name, (_, load) in exported.mounted.items():
        body = element("body", element("inertial", **inertial_of(load.body)), name=name)
        carriers[load.joint].extend((comment(load.words), body))
    return bodies[0]


def _joint(
    exported: ExportedRobot, values: JointValues, native: NativeEffects, joint: int
) -> dict[str, str]:
    robot, law = exported.robot, exported.law
    axis = np.array(exported.urdf.joints[robot.joints[joint]].axis)
    damping = np.array([values.damping[joint], *native.damping.get(joint, ())])
    attributes = {
        "name": robot.joints[joint],
        "type": "hinge" if robot.joint_types[joint] == "revolute" else "slide",
        "axis": _exact(*axis / np.linalg.norm(axis)),
        "armature": number_text(values.armature[joint]),
        "damping": numbers_text(damping),
        "frictionloss": number_text(values.friction[joint]),
    }
    if values.friction[joint] > 0.0:
        attributes |= friction_solver(float(values.lead[joint]), law.period)
    limits = [robot.limits.lower[joint], robot.limits.upper[joint]]
    if np.all(np.isfinite(limits)):
        attributes["range"] = _exact(*limits)
    if joint in native.stiffness:
        attributes["stiffness"] = _exact(*native.stiffness[joint])
    limit = law.limit[joint]
    if law.in_actuators and math.isfinite(limit):
        attributes["actuatorfrcrange"] = _exact(-limit, limit)
    return attributes


def _visual_geom(tree: pin.Model, index: int, body: pin.Inertia) -> dict[str, str]:
    """Return a visual geom, without mass and contacts."""
    child = next((k for k in range(1, tree.njoints) if int(tree.parents[k]) == index), None)
    end = 2.0 * body.lever if child is None else np.array(tree.jointPlacements[child].translation)
    length = float(np.linalg.norm(end))
    shape = {"type": "sphere", "size": "0.03"}
    if length > 1e-3:
        size = _exact(round(_THICKNESS * length, 4))
        shape = {"type": "capsule", "fromto": _exact(0.0, 0.0, 0.0, *end), "size": size}
    return shape | {"contype": "0", "conaffinity": "0", "group": "2", "mass": "0"}


def _actuators(law: DriveLaw, joints: Sequence[str]) -> Iterator[Element]:
    """Return the actuators: the control law at each joint, or a motor."""
    for joint, name in enumerate(joints):
        kp, kd = (law.kp[joint], law.kd[joint]) if law.in_actuators else (0.0, 0.0)
        gain = kp if law.in_actuators else 1.0
        attributes = {"biastype": "affine", "biasprm": _exact(0.0, -kp, -kd)}
        if not law.in_actuators and math.isfinite(law.limit[joint]):
            attributes["ctrlrange"] = _exact(-law.limit[joint], law.limit[joint])
        if law.delay[joint] > 0.0:  # no law with a delay is in the actuators
            samples = math.ceil(law.delay[joint] / law.period - 1e-9) + 1
            attributes |= {"delay": _exact(law.delay[joint]), "nsample": str(samples)}
        yield element("general", name=name, joint=name, gainprm=_exact(gain), **attributes)
    if law.in_actuators and law.velocity_reference:
        for name, gain in zip(joints, law.kd, strict=True):
            yield element("general", name=f"{name}_velocity", joint=name, gainprm=_exact(gain))


def _placement(place: pin.SE3) -> dict[str, str]:
    turn = pin.Quaternion(place.rotation).normalized()
    return {"pos": _exact(*place.translation), "quat": _exact(turn.w, turn.x, turn.y, turn.z)}


def _exact(*values: float) -> str:
    return " ".join(repr(float(value) + 0.0) for value in values)


def number_text(value: float) -> str:
    """Return a number as text with up to eight significant digits, and without negative zero."""
    return f"{float(value) + 0.0:.8g}"


def numbers_text(values: FloatArray) -> str:
    """Return numbers of one kind as text, rounded at the same digit, set by the largest."""
    largest = float(np.abs(values).max())
    digits = 7 - math.floor(math.log10(largest)) if largest > 0.0 else 0
    return " ".join(number_text(round(float(value), digits)) for value in values)


def comment(text: str) -> Any:
    """Return a text as an XML comment."""
    return ElementTree.Comment(f" {text.replace('--', '- -')} ")
