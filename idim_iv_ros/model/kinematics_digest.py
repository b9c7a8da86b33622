"""A digest of the geometry of a robot: whether a result belongs to a URDF."""

import hashlib

import numpy as np

from idim_iv_ros.model.robot import RobotModel

_DIGITS = 9  # of lengths in m and of directions; what is rounded beyond is the same robot


def kinematics_digest(robot: RobotModel) -> str:
    """SHA-256 of joints, their types, their order in the tree, placements and axes."""
    model = robot.pinocchio
    parts = [*robot.joints, *robot.joint_types, *map(str, robot.order), *map(str, model.parents)]
    for place, joint in zip(model.jointPlacements[1:], model.joints[1:], strict=True):
        axis = np.ravel(joint.createData().S)
        numbers = np.concatenate([place.homogeneous[:3].ravel(), axis])
        # Adding zero: no negative zeros.
        parts += [f"{number:.{_DIGITS}f}" for number in np.round(numbers, _DIGITS) + 0.0]
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()
