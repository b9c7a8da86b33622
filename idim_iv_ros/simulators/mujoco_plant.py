"""A robot model as a MuJoCo model: bodies, joints, drives, friction and one motor a joint.

Base parameters are known, and not every standard parameter: `nearest_parameters` takes those that
are nearest to the nominal model. They need not be physical, and MuJoCo computes with them all the
same; its compiler would refuse them, so that they are set behind it.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pinocchio as pin

from idim_iv_ros.errors import UsageError
from idim_iv_ros.model import DynamicParameters, InverseModel, RobotModel
from idim_iv_ros.model.link_motion import link_frames
from idim_iv_ros.model.mujoco_package import set_first
from idim_iv_ros.types import FloatArray

REPLAY = "replay_"
_LEAST_SHARE = 0.1  # of the largest value of its kind, by which a standard parameter may move
_LEAST_MASS = 1e-6  # kg


def nearest_parameters(model: InverseModel, values: FloatArray) -> DynamicParameters:
    """Standard parameters with these base parameters (b,), nearest to the nominal model.

    Distances are relative: what is small in the nominal model moves little.
    """
    layout = model.regressor.layout
    nominal = layout.vector(model.robot.given)
    grouping = model.base.grouping
    kinds = [parameter.kind for parameter in layout.parameters]
    largest = dict.fromkeys(kinds, 0.0)
    for kind, value in zip(kinds, nominal, strict=True):
        largest[kind] = max(largest[kind], abs(value))
    overall = max(largest.values())
    least = np.array([largest[kind] or overall for kind in kinds])
    weight = (np.abs(nominal) + _LEAST_SHARE * least) ** 2
    change = values - grouping @ nominal
    weighted = grouping * weight
    step = weighted.T @ np.linalg.lstsq(weighted @ grouping.T, change, rcond=1e-13)[0]
    return layout.dynamic_parameters(nominal + step)


def plant_spec(mujoco: Any, robot: RobotModel, parameters: DynamicParameters) -> Any:
    """Return the kinematic tree with drives and friction; inertias are still to be set.

    Raises
    ------
    UsageError
        Couplings of joints, which have no counterpart here.
    """
    if len(parameters.coupling_joints):
        raise UsageError("robot.couplings: a transmission that couples joints cannot be replayed")
    spec = mujoco.MjSpec()
    spec.modelname = robot.name
    spec.compiler.degree = False
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.gravity = robot.pinocchio.gravity.linear
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
    """One motor a joint, whose control is its torque."""
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
        if abs(mass) < _LEAST_MASS:
            if np.any(np.abs(values[1:4]) > _LEAST_MASS):
                raise UsageError(f"{robot.name}: the link of {name} has a moment and no mass")
            centre = np.zeros(3)
        else:
            centre = values[1:4] / mass
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
