"""Torques of given motions, mass matrix and direct dynamics of a robot with any parameters."""

from collections.abc import Callable
from typing import Any

import numpy as np

from idim_iv_ros.compilation import entry, source_digest
from idim_iv_ros.model import link_motion
from idim_iv_ros.model.link_motion import place_links
from idim_iv_ros.model.parameters import DynamicParameters
from idim_iv_ros.model.robot import RobotModel
from idim_iv_ros.simulation import rigid_body
from idim_iv_ros.simulation.plant import Plant, Workspace, plant, workspace
from idim_iv_ros.simulation.rigid_body import composite_rigid_body, newton_euler
from idim_iv_ros.types import FloatArray


def _entries(digest: str) -> tuple[Callable[..., Any], Callable[..., Any]]:
    """Compile the functions that Python calls; `digest` is part of their key in the cache."""

    @entry
    def torques(
        plant: Plant,
        q: FloatArray,
        dq: FloatArray,
        ddq: FloatArray,
        work: Workspace,
        torque: FloatArray,
    ) -> None:
        _ = digest
        samples, n = q.shape
        for k in range(samples):
            place_links(plant, q[k], work)
            newton_euler(plant, dq[k], ddq[k], work, torque[k])
            for i in range(n):
                total = plant.offset[i]
                for j in range(n):
                    total += plant.drive_inertia[i, j] * ddq[k, j] + plant.damping[i, j] * dq[k, j]
                torque[k, i] += total
            for c in range(plant.level.shape[0]):
                a, b = plant.first[c], plant.second[c]
                speed = dq[k, a] + dq[k, b] if b >= 0 else dq[k, a]
                friction = plant.level[c] * np.sign(speed)
                torque[k, a] += friction
                if b >= 0:
                    torque[k, b] += friction

    @entry
    def masses(plant: Plant, q: FloatArray, work: Workspace, mass: FloatArray) -> None:
        _ = digest
        for k in range(q.shape[0]):
            place_links(plant, q[k], work)
            composite_rigid_body(plant, work, mass[k])
            for i in range(q.shape[1]):
                for j in range(q.shape[1]):
                    mass[k, i, j] += plant.drive_inertia[i, j]

    return torques, masses


_torques, _masses = _entries(source_digest(link_motion, rigid_body))


def inverse_dynamics(
    robot: RobotModel,
    parameters: DynamicParameters,
    q: FloatArray,
    dq: FloatArray,
    ddq: FloatArray,
) -> FloatArray:
    """Torques that a motion needs: IDM(q, dq, ddq) β (paper, equation 3).

    Exactly the linear model: sign(0) = 0, and negative friction is taken as it is.

    Parameters
    ----------
    robot, parameters
        Kinematics, and dynamic parameters that need not be physical.
    q, dq, ddq
        (n_samples, n_joints) rad, rad/s, rad/s² (m, … for prismatic joints).

    Returns
    -------
    (n_samples, n_joints) N m (N)
    """
    order = robot.order
    dynamics = plant(robot, parameters, dissipative=False)
    motion = (np.ascontiguousarray(values[:, order], dtype=float) for values in (q, dq, ddq))
    torque = np.zeros(q.shape)
    _torques(dynamics, *motion, workspace(dynamics), torque)
    return np.ascontiguousarray(torque[:, np.argsort(order)])


def mass_matrix(robot: RobotModel, parameters: DynamicParameters, q: FloatArray) -> FloatArray:
    """Mass matrix with drive inertia, (n_samples, n_joints, n_joints), at q (n_samples, n_joints).

    kg m² (kg, kg m) in the order of the robot's joints; need not be positive definite.
    """
    samples, joints = q.shape
    dynamics = plant(robot, parameters, dissipative=False)
    mass = np.zeros((samples, joints, joints))
    _masses(dynamics, np.ascontiguousarray(q[:, robot.order]), workspace(dynamics), mass)
    place = np.argsort(robot.order)
    return np.ascontiguousarray(mass[:, place][:, :, place])


def joint_inertia(robot: RobotModel, parameters: DynamicParameters, q: FloatArray) -> FloatArray:
    """Mean diagonal of the mass matrix over positions (n_samples, n_joints): (n_joints,) kg m²."""
    return np.asarray(np.einsum("sjj->j", mass_matrix(robot, parameters, q)) / len(q))
