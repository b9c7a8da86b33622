"""Torque of the links under gravities of any direction."""

from dataclasses import replace

import numpy as np

from idim_iv_ros.diagnosis.refit.baseline import Baseline
from idim_iv_ros.model import RobotModel
from idim_iv_ros.simulation import inverse_dynamics
from idim_iv_ros.types import FloatArray


def unit_gravity_rows(data: Baseline, accelerations: FloatArray) -> list[FloatArray]:
    """Torque of the given links under each of k gravities (k, 3): (r_j, k) for each joint, N m."""
    robot = data.prepared.model.robot
    tilted = [_with_gravity(robot, acceleration) for acceleration in accelerations]
    bodies = robot.given.of_links
    parts = []
    for motion in data.motions:
        still = np.zeros_like(motion.position)
        torques = [inverse_dynamics(each, bodies, motion.position, still, still) for each in tilted]
        parts.append(motion.rows(np.concatenate(torques, axis=1)))
    n = len(robot.joints)
    return [data.counting(joint, [part[:, joint::n] for part in parts]) for joint in range(n)]


def _with_gravity(robot: RobotModel, gravity: FloatArray) -> RobotModel:
    model = robot.pinocchio.copy()
    model.gravity.linear = gravity
    return replace(robot, pinocchio=model)
