"""MuJoCo models from a robot: bodies, motors, and parts for effects.

Base parameters are known, but not every standard parameter: `nearest_parameters` takes those
nearest to the nominal model. They need not be physical; MuJoCo simulates them nevertheless, but its
compiler refuses them, so that they are set after compilation.

Elasticity and backlash make two masses of a joint. The joint becomes that of the motor, with its
armature, friction and actuators; a second one on the same body, ``NAME_shaft`` about the same axis,
is the position of the link less that of the motor. Friction between two joints is that of a tendon
``A_B_coupling`` over both.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from idim_iv_ros.effects.contribution import ShaftPart
from idim_iv_ros.errors import UsageError
from idim_iv_ros.files import FilePath
from idim_iv_ros.model import DynamicParameters, InverseModel, RobotModel
from idim_iv_ros.model.link_motion import link_frames
from idim_iv_ros.model.mujoco_package import load_mujoco, mujoco_reads, set_first
from idim_iv_ros.simulation.affected_robot import completed_shaft, joined_shafts
from idim_iv_ros.simulation.effects import JointContributions, SimulatedEffect, contributions_of
from idim_iv_ros.simulators.effects_file import read_effects
from idim_iv_ros.types import FloatArray

REPLAY = "replay_"
_LEAST_SHARE = 0.1  # of the largest value of its kind, by which a standard parameter may move
_LEAST_MASS = 1e-6  # kg


def nearest_parameters(model: InverseModel, values: FloatArray) -> DynamicParameters:
    """Return the standard parameters nearest to the nominal ones with base parameters (b,).

    Distances are relative: parameters that are small in the nominal model change little.
    """
    layout = model.regressor.layout
    nominal = layout.vector(model.robot.given)
    grouping = model.base.grouping
    kinds, sizes = np.array([parameter.kind for parameter in layout.parameters]), np.abs(nominal)
    largest = np.array([sizes[kinds == kind].max() for kind in kinds])
    weight = (sizes + _LEAST_SHARE * np.where(largest > 0.0, largest, sizes.max())) ** 2
    change = values - grouping @ nominal
    weighted = grouping * weight
    step = weighted.T @ np.linalg.lstsq(weighted @ grouping.T, change, rcond=1e-13)[0]
    return layout.dynamic_parameters(nominal + step)


def plant_spec(mujoco: Any, robot: RobotModel, parameters: DynamicParameters) -> Any:
    """Return the kinematic tree with drives and friction; `set_inertias` must follow.

    Raises UsageError: couplings of joints, which are not supported here.
    """
    if len(parameters.coupling_joints):
        raise UsageError("robot.couplings: a transmission that couples joints cannot be replayed")
    spec = mujoco.MjSpec()
    spec.modelname = robot.name
    spec.compiler.degree = False
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.gravity = robot.gravity
    turned = link_frames(robot).turned
    bodies = [spec.worldbody]
    for tree, joint in enumerate(robot.order, start=1):
        placement = robot.pinocchio.jointPlacements[tree]
        body = bodies[int(robot.pinocchio.parents[tree])].add_body(
            name=f"link_{robot.joints[joint]}",
            pos=placement.translation,
            quat=_quaternion(placement.rotation),
        )
        # A frame of inertia that is none of the body's, so that MuJoCo takes no short cut.
        body.mass, body.inertia = 1.0, [0.4, 0.5, 0.6]
        body.ipos, body.iquat = [0.1, 0.2, 0.3], [0.8, 0.4, 0.4, 0.2]
        body.explicitinertial = True
        kind = mujoco.mjtJoint
        revolute = robot.joint_types[joint] == "revolute"
        element = body.add_joint(
            name=robot.joints[joint],
            type=kind.mjJNT_HINGE if revolute else kind.mjJNT_SLIDE,
            axis=turned[tree][:, 2],
        )
        element.armature = max(float(parameters.drive_inertia[joint]), 0.0)
        element.frictionloss = max(float(parameters.coulomb[joint]), 0.0)
        set_first(element, "damping", max(float(parameters.viscous[joint]), 0.0))
        bodies.append(body)
    return spec


def add_motors(mujoco: Any, spec: Any, joints: Sequence[str]) -> None:
    """Add one motor to each joint, whose control is its torque."""
    for name in joints:
        motor = spec.add_actuator(name=REPLAY + name, target=name)
        motor.trntype = mujoco.mjtTrn.mjTRN_JOINT
        motor.gear[0] = 1.0
        # Whatever the defaults of a user's file make of an actuator.
        motor.dyntype, motor.gaintype = mujoco.mjtDyn.mjDYN_NONE, mujoco.mjtGain.mjGAIN_FIXED
        motor.biastype, motor.gainprm[0] = mujoco.mjtBias.mjBIAS_NONE, 1.0
        motor.ctrllimited = motor.forcelimited = mujoco.mjtLimited.mjLIMITED_FALSE


def set_inertias(mujoco: Any, model: Any, robot: RobotModel, parameters: DynamicParameters) -> None:
    """Set masses and inertias of a compiled model, physical or not."""
    for joint, name in enumerate(robot.joints):
        body = int(model.jnt_bodyid[model.joint(name).id])
        mass, *_ = values = parameters.inertial[joint]
        if abs(mass) < _LEAST_MASS and np.any(np.abs(values[1:4]) > _LEAST_MASS):
            raise UsageError(f"{robot.name}: the link of {name} has a moment and no mass")
        centre = values[1:4] / mass if abs(mass) >= _LEAST_MASS else np.zeros(3)
        xx, xy, yy, xz, yz, zz = values[4:]
        origin = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        about = origin - mass * (centre @ centre * np.eye(3) - np.outer(centre, centre))
        moments, axes = np.linalg.eigh(about)
        if np.linalg.det(axes) < 0.0:
            axes[:, 0] *= -1.0
        model.body_mass[body], model.body_ipos[body] = mass, centre
        model.body_inertia[body], model.body_iquat[body] = moments, _quaternion(axes)
    mujoco.mj_setConst(model, mujoco.MjData(model))


def _quaternion(rotation: FloatArray) -> FloatArray:
    x, y, z, w = pin.Quaternion(np.asarray(rotation)).coeffs()
    return np.array([w, x, y, z])


SHAFT, COUPLING = "_shaft", "_coupling"
# A step is at most this over the pulsation of a shaft, rad; MuJoCo's springs are explicit.
LARGEST_ANGLE = 0.8


class StepTooLongError(UsageError):
    """The time step of a model does not resolve one of its shafts."""


def model_with_effects(model: FilePath, effects: FilePath) -> Any:
    """Compile an MJCF with the parts that the effects of a file need.

    Without elasticity, backlash and joint coupling it is the model of the file as it is.

    Raises UsageError: MuJoCo is not installed, a file cannot be read, an effect or joint is not
    known.
    """
    mujoco = load_mujoco("a model with effects")
    parts = read_effects(Path(effects)).effects
    with mujoco_reads(model):
        spec = mujoco.MjSpec.from_file(str(model))
        add_parts(spec, parts)
        compiled = spec.compile()
    return compiled


def add_parts(spec: Any, effects: Sequence[SimulatedEffect]) -> None:
    """Add shafts and couplings to a specification that is not compiled yet."""
    joints = [joint.name for joint in spec.joints if joint.name]
    parts = contributions_of([effect for effect in effects if not effect.native], joints)
    for joint in dict.fromkeys(joint for joint, _ in parts.of(ShaftPart)):
        _add_shaft(spec, joints[joint])
    for first, second, term in parts.couplings:
        name = coupling_name(joints[first], joints[second])
        if spec.tendon(name) is None:
            tendon = spec.add_tendon(name=name)
            tendon.wrap_joint(joints[first], 1.0)
            tendon.wrap_joint(joints[second], float(term.direction))


def _add_shaft(spec: Any, name: str) -> None:
    if spec.joint(name + SHAFT) is not None:
        return
    joint = spec.joint(name)
    if float(joint.armature) <= 0.0:
        raise UsageError(
            f"elasticity or backlash at {name} needs its drive inertia: the joint has no armature"
        )
    if len(joint.parent.joints) > 1:
        raise UsageError(f"elasticity or backlash at {name}: its body has several joints")
    shaft = joint.parent.add_joint(
        name=name + SHAFT, type=joint.type, pos=joint.pos, axis=joint.axis
    )
    for key in ("armature", "frictionloss", "damping", "stiffness"):  # not those of a default
        setattr(shaft, key, 0.0 * getattr(joint, key))


def coupling_name(first: str, second: str) -> str:
    """Return the name of the tendon that couples two joints."""
    return f"{first}_{second}{COUPLING}"


class MujocoShafts:
    """Shafts of the joints that have one, as joints ``NAME_shaft``: link less motor position.

    Such a joint has stiffness and damping outside of its backlash, and neither within it.

    Raises UsageError: the model has no such joint, or its time step is too long for the shaft.
    """

    def __init__(
        self, mujoco: Any, model: Any, joints: Sequence[str], added: JointContributions
    ) -> None:
        self._mujoco = mujoco
        # Each with the numbers of its joint, its position and its velocity in the model.
        self._shafts: list[tuple[ShaftPart, int, int, int]] = []
        present = {model.joint(k).name for k in range(model.njnt)}
        for place, shaft in joined_shafts(added.of(ShaftPart)).items():
            name = joints[place]
            if name + SHAFT not in present:
                raise UsageError(
                    f"elasticity or backlash at {name}: the model has no joint {name + SHAFT}; "
                    "build it with model_with_effects(xml, effects)"
                )
            joint = model.joint(name + SHAFT)
            dof = int(joint.dofadr[0])
            data = mujoco.MjData(model)
            mujoco.mj_forward(model, data)
            unit, response = np.zeros((2, 1, model.nv))
            unit[0, dof] = 1.0
            mujoco.mj_solveM(model, data, response, unit)
            # The motor is not held: its own inertia is part of the mobility of the twist.
            complete, pulsation = completed_shaft(shaft, 1.0 / float(response[0, dof]))
            longest = LARGEST_ANGLE / pulsation
            if model.opt.timestep > longest:
                raise StepTooLongError(
                    f"elasticity or backlash at {name} swings fast: the model's timestep is "
                    f"{model.opt.timestep:g} s and {longest:.2g} s or less is needed"
                )
            self._shafts.append((complete, int(joint.id), int(joint.qposadr[0]), dof))

    def apply(self, model: Any, data: Any) -> None:
        """Set stiffness and damping of the shafts for this step."""
        for shaft, joint, place, dof in self._shafts:
            twist, rate = -data.qpos[place], -data.qvel[dof]
            stiffness, damping = shaft.stiffness, shaft.damping
            side = 1.0 if twist > 0.0 else -1.0
            if shaft.gap > 0.0:
                bent = side * twist - 0.5 * shaft.gap
                if bent <= 0.0 or stiffness * bent + damping * side * rate <= 0.0:
                    stiffness = damping = 0.0
            model.qpos_spring[place] = -0.5 * side * shaft.gap
            first_column(model.jnt_stiffness)[joint] = stiffness
            first_column(model.dof_damping)[dof] = damping

    def place(self, model: Any, data: Any) -> None:
        """Put the links at rest into equilibrium with gravity behind their motors."""
        load, speed = np.empty(model.nv), np.array(data.qvel)
        for _ in range(30 if self._shafts else 0):
            data.qvel[:] = 0.0
            self._mujoco.mj_fwdPosition(model, data)
            self._mujoco.mj_fwdVelocity(model, data)
            self._mujoco.mj_rne(model, data, 0, load)
            for shaft, _, place, dof in self._shafts:
                bent = load[dof] / shaft.stiffness + 0.5 * shaft.gap * np.sign(load[dof])
                data.qpos[place] = -bent
                speed[dof] = 0.0
        data.qvel[:] = speed


def first_column(values: Any) -> Any:
    """Return the linear coefficients of stiffness or damping, in any version of MuJoCo."""
    return values if values.ndim == 1 else values[:, 0]
