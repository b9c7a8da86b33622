"""Link frames of a robot as arrays: each turned so that its joint moves along or about z."""

from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from idim_iv_ros.model.robot import RobotModel
from idim_iv_ros.types import FloatArray, IntArray


class LinkFrames(NamedTuple):
    """Kinematic tree with joints numbered from 1 in its order, as in pinocchio; 0 is the base.

    Attributes
    ----------
    parent, revolute : (n + 1,)
    rotation, translation : (n + 1, 3, 3), (n + 1, 3)
        Constant placement of each turned frame in its parent's.
    turned : (n + 1, 3, 3)
        Rotation from the turned frame to pinocchio's, in which inertial parameters are given.
    gravity : (3,)
        m/s², in the base.
    """

    parent: IntArray
    revolute: NDArray[np.bool_]
    rotation: FloatArray
    translation: FloatArray
    turned: FloatArray
    gravity: FloatArray


def link_frames(robot: RobotModel) -> LinkFrames:
    """Shape the kinematics of a robot for compiled code."""
    model = robot.pinocchio
    turned = _turned_frames(model)
    rotation, translation = np.zeros((model.njoints, 3, 3)), np.zeros((model.njoints, 3))
    for joint in range(1, model.njoints):
        parent, placement = turned[model.parents[joint]], model.jointPlacements[joint]
        rotation[joint] = parent.T @ placement.rotation @ turned[joint]
        translation[joint] = parent.T @ placement.translation
    types = [robot.joint_types[joint] for joint in robot.order]
    return LinkFrames(
        parent=np.array(list(model.parents), dtype=np.int64),
        revolute=np.array([False, *(joint_type == "revolute" for joint_type in types)]),
        rotation=rotation,
        translation=translation,
        turned=np.array(turned),
        gravity=np.array(model.gravity.linear, dtype=float),
    )


def _turned_frames(model: pin.Model) -> list[FloatArray]:
    """Rotation that takes z to the joint's axis, for the base and each joint."""
    data = model.createData()
    pin.computeJointJacobians(model, data, pin.neutral(model))
    turned = [np.eye(3)]
    for joint in range(1, model.njoints):
        jacobian = pin.getJointJacobian(model, data, joint, pin.ReferenceFrame.LOCAL)
        motion = jacobian.reshape(6, -1)[:, model.joints[joint].idx_v]
        axis = motion[3:] if np.linalg.norm(motion[3:]) > 0.5 else motion[:3]
        if axis[2] == 1.0:
            turned.append(np.eye(3))
            continue
        helper = np.eye(3)[np.argmin(np.abs(axis))]
        x = np.cross(helper, axis)
        x /= np.linalg.norm(x)
        turned.append(np.column_stack([x, np.cross(axis, x), axis]))
    return turned
