"""Rigid-body dynamics, linear in the inertial parameters: compiled recursive algorithms.

`inverse_dynamics` and `mass_matrix` are those of a whole robot, drives and friction included.

Base parameters are not physical: a link may have first moments and no mass. pinocchio's own
inertias (mass, centre of mass) cannot hold such values, so that its forward dynamics cannot
simulate an estimate; these algorithms take M, MX … ZZ about the joint frame as they are.

Conventions: joints are numbered from 1 in the order of the tree, as in pinocchio, and row 0 is
the base. Every link frame is turned so that its joint moves along or about z (see `LinkFrames`).

Source: Khalil and Dombre, Modeling, Identification and Control of Robots, chapter 9 (recursive
Newton-Euler linear in the parameters); Featherstone, Rigid Body Dynamics Algorithms, chapter 6
(composite rigid bodies).
"""

from typing import Any

import numpy as np

from idim_iv_ros.compilation import entry, kernel, source_digest
from idim_iv_ros.model import DynamicParameters, RobotModel, link_motion
from idim_iv_ros.model.link_motion import move_links, place_links, turn
from idim_iv_ros.simulation import dry_friction
from idim_iv_ros.simulation.dry_friction import push, slip
from idim_iv_ros.simulation.plant import Plant, Workspace, plant, workspace
from idim_iv_ros.types import FloatArray

_INERTIA_STATES = 50  # at least, where there are as many: inertias change slowly
Wrench = tuple[float, float, float, float, float, float]  # Force, then torque


@kernel
def newton_euler(
    plant: Plant, dq: FloatArray, ddq: FloatArray, work: Workspace, torque: FloatArray
) -> None:
    """Torques of the rigid bodies by recursive Newton-Euler, moments about the link origins.

    Links must have been placed.
    """
    n, motion = dq.shape[0], work.motion
    move_links(plant.frames, dq, ddq, motion)
    for i in range(1, n + 1):
        g, f = motion.gradient[i], work.wrench[i]
        a0, a1, a2 = motion.acceleration[i, 0], motion.acceleration[i, 1], motion.acceleration[i, 2]
        w0, w1, w2 = motion.spin[i, 0], motion.spin[i, 1], motion.spin[i, 2]
        d0, d1, d2 = motion.spin_rate[i, 0], motion.spin_rate[i, 1], motion.spin_rate[i, 2]
        link = plant.inertial[i]
        m, x, y, z = link[0], link[1], link[2], link[3]
        f[0] = m * a0 + g[0, 0] * x + g[0, 1] * y + g[0, 2] * z
        f[1] = m * a1 + g[1, 0] * x + g[1, 1] * y + g[1, 2] * z
        f[2] = m * a2 + g[2, 0] * x + g[2, 1] * y + g[2, 2] * z
        h0, h1, h2 = _spun(link, w0, w1, w2)
        e0, e1, e2 = _spun(link, d0, d1, d2)
        f[3] = e0 + w1 * h2 - w2 * h1 + y * a2 - z * a1
        f[4] = e1 + w2 * h0 - w0 * h2 + z * a0 - x * a2
        f[5] = e2 + w0 * h1 - w1 * h0 + x * a1 - y * a0
    for i in range(n, 0, -1):
        f, u = work.wrench[i], plant.frames.parent[i]
        torque[i - 1] = f[5] if plant.frames.revolute[i] else f[2]
        if u > 0:
            rot, p = work.motion.rotation[i], work.motion.translation[i]
            carried = _carried(rot, p, (f[0], f[1], f[2], f[3], f[4], f[5]))
            for k in range(6):
                work.wrench[u, k] += carried[k]


@kernel
def _spun(link: FloatArray, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Product of the moments of inertia (XX, XY, YY, XZ, YZ, ZZ) of a link and a vector."""
    return (
        link[4] * x + link[5] * y + link[7] * z,
        link[5] * x + link[6] * y + link[8] * z,
        link[7] * x + link[8] * y + link[9] * z,
    )


@kernel
def _carried(rot: FloatArray, p: FloatArray, wrench: Wrench) -> Wrench:
    """Wrench of a link in the frame of its parent."""
    e0, e1, e2 = turn(rot, wrench[0], wrench[1], wrench[2])
    s0, s1, s2 = turn(rot, wrench[3], wrench[4], wrench[5])
    s0, s1, s2 = s0 + p[1] * e2 - p[2] * e1, s1 + p[2] * e0 - p[0] * e2, s2 + p[0] * e1 - p[1] * e0
    return e0, e1, e2, s0, s1, s2


@kernel
def composite_rigid_body(plant: Plant, work: Workspace, mass: FloatArray) -> None:
    """Mass matrix (n, n) of the rigid bodies; links must have been placed."""
    n = mass.shape[0]
    for i in range(n + 1):
        for k in range(10):
            work.composite[i, k] = plant.inertial[i, k]
    for i in range(n):
        for j in range(n):
            mass[i, j] = 0.0
    for i in range(n, 0, -1):
        c, u = work.composite[i], plant.frames.parent[i]
        if plant.frames.revolute[i]:
            wrench = (-c[2], c[1], 0.0, c[7], c[8], c[9])
        else:
            wrench = (0.0, 0.0, c[0], c[2], -c[1], 0.0)
        j = i
        while True:
            entry = wrench[5] if plant.frames.revolute[j] else wrench[2]
            mass[i - 1, j - 1] = entry
            mass[j - 1, i - 1] = entry
            if plant.frames.parent[j] == 0:
                break
            wrench = _carried(work.motion.rotation[j], work.motion.translation[j], wrench)
            j = plant.frames.parent[j]
        if u > 0:
            _join(work.motion.rotation[i], work.motion.translation[i], c, work.composite[u])


@kernel
def _join(rot: FloatArray, p: FloatArray, link: FloatArray, total: FloatArray) -> None:
    """Add the inertial parameters of a link to those of its parent, in the parent's frame."""
    m = link[0]
    h0, h1, h2 = turn(rot, link[1], link[2], link[3])
    p0, p1, p2 = p[0], p[1], p[2]
    total[0] += m
    total[1] += h0 + m * p0
    total[2] += h1 + m * p1
    total[3] += h2 + m * p2
    a0, a1, a2 = _spun(link, rot[0, 0], rot[0, 1], rot[0, 2])
    b0, b1, b2 = _spun(link, rot[1, 0], rot[1, 1], rot[1, 2])
    c0, c1, c2 = _spun(link, rot[2, 0], rot[2, 1], rot[2, 2])
    s0, s1 = m * p0 * p0 + 2.0 * p0 * h0, m * p1 * p1 + 2.0 * p1 * h1
    s2 = m * p2 * p2 + 2.0 * p2 * h2
    total[4] += a0 * rot[0, 0] + a1 * rot[0, 1] + a2 * rot[0, 2] + s1 + s2
    total[5] += a0 * rot[1, 0] + a1 * rot[1, 1] + a2 * rot[1, 2] - m * p0 * p1 - p0 * h1 - p1 * h0
    total[6] += b0 * rot[1, 0] + b1 * rot[1, 1] + b2 * rot[1, 2] + s0 + s2
    total[7] += a0 * rot[2, 0] + a1 * rot[2, 1] + a2 * rot[2, 2] - m * p0 * p2 - p0 * h2 - p2 * h0
    total[8] += b0 * rot[2, 0] + b1 * rot[2, 1] + b2 * rot[2, 2] - m * p1 * p2 - p1 * h2 - p2 * h1
    total[9] += c0 * rot[2, 0] + c1 * rot[2, 1] + c2 * rot[2, 2] + s0 + s1


def _entries(digest: str) -> tuple[Any, Any]:
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
            place_links(plant.frames, q[k], work.motion)
            newton_euler(plant, dq[k], ddq[k], work, torque[k])
            for i in range(n):
                total = plant.offset[i]
                for j in range(n):
                    total += plant.drive_inertia[i, j] * ddq[k, j] + plant.damping[i, j] * dq[k, j]
                torque[k, i] += total
            for c in range(plant.level.shape[0]):
                friction = plant.level[c] * np.sign(slip(plant.contacts, c, dq[k]))
                push(plant.contacts, c, friction, torque[k])

    @entry
    def masses(plant: Plant, q: FloatArray, work: Workspace, mass: FloatArray) -> None:
        _ = digest
        for k in range(q.shape[0]):
            place_links(plant.frames, q[k], work.motion)
            composite_rigid_body(plant, work, mass[k])
            for i in range(q.shape[1]):
                for j in range(q.shape[1]):
                    mass[k, i, j] += plant.drive_inertia[i, j]

    return torques, masses


_torques, _masses = _entries(source_digest(link_motion, dry_friction))


def inverse_dynamics(
    robot: RobotModel, parameters: DynamicParameters, q: FloatArray, dq: FloatArray, ddq: FloatArray
) -> FloatArray:
    """Torques (n_samples, n_joints) N m (N) of a motion: IDM(q, dq, ddq) β (paper, equation 3).

    Exactly the linear model of parameters that need not be physical: sign(0) = 0, and negative
    friction is taken as it is. `q`, `dq`, `ddq`: (n_samples, n_joints) rad, rad/s, rad/s² (m, …).
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
    """Mean diagonal of the mass matrix over some of positions (s, n_joints): (n_joints,) kg m²."""
    some = q[:: max(1, len(q) // _INERTIA_STATES)]
    return np.asarray(np.einsum("sjj->j", mass_matrix(robot, parameters, some)) / len(some))
