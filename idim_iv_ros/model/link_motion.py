"""Placement and motion of the links of a robot: compiled, for its torques and its regressor.

Source: Khalil and Dombre, Modeling, Identification and Control of Robots, chapter 9 (recursive
Newton-Euler linear in the parameters).
"""

import math
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from idim_iv_ros.compilation import kernel
from idim_iv_ros.model.robot import RobotModel
from idim_iv_ros.types import FloatArray, IntArray


class LinkFrames(NamedTuple):
    """Kinematic tree with joints numbered from 1 in its order, as in pinocchio; 0 is the base."""

    # parent, revolute: (n + 1,)
    parent: IntArray
    revolute: NDArray[np.bool_]
    # rotation, translation: (n + 1, 3, 3), (n + 1, 3): constant placement of each turned frame in
    # its parent's
    rotation: FloatArray
    translation: FloatArray
    # (n + 1, 3, 3): rotation from the turned frame to pinocchio's, in which inertial parameters are
    # given
    turned: FloatArray
    gravity: FloatArray  # (3,) m/s², in the base


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


class LinkMotion(NamedTuple):
    """Placement of every link in its parent, spin, and motion of its origin; row 0: the base.

    rotation, gradient : (n + 1, 3, 3); translation, spin, spin_rate, acceleration : (n + 1, 3)
    """

    rotation: FloatArray
    translation: FloatArray
    spin: FloatArray
    spin_rate: FloatArray
    gradient: FloatArray
    acceleration: FloatArray


def empty_motion(joints: int) -> LinkMotion:
    """Allocate the arrays for a robot of so many joints."""
    matrices, vectors = (joints + 1, 3, 3), (joints + 1, 3)
    return LinkMotion(
        rotation=np.zeros(matrices),
        translation=np.zeros(vectors),
        spin=np.zeros(vectors),
        spin_rate=np.zeros(vectors),
        gradient=np.zeros(matrices),
        acceleration=np.zeros(vectors),
    )


@kernel
def turn(rotation: FloatArray, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Product of a rotation and a vector."""
    return (
        rotation[0, 0] * x + rotation[0, 1] * y + rotation[0, 2] * z,
        rotation[1, 0] * x + rotation[1, 1] * y + rotation[1, 2] * z,
        rotation[2, 0] * x + rotation[2, 1] * y + rotation[2, 2] * z,
    )


@kernel
def turn_back(rotation: FloatArray, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Product of the inverse of a rotation and a vector."""
    return (
        rotation[0, 0] * x + rotation[1, 0] * y + rotation[2, 0] * z,
        rotation[0, 1] * x + rotation[1, 1] * y + rotation[2, 1] * z,
        rotation[0, 2] * x + rotation[1, 2] * y + rotation[2, 2] * z,
    )


@kernel
def place_links(tree: LinkFrames, q: FloatArray, work: LinkMotion) -> None:
    """Placement of each link frame in its parent's."""
    for i in range(1, q.shape[0] + 1):
        angle = q[i - 1] if tree.revolute[i] else 0.0
        shift = 0.0 if tree.revolute[i] else q[i - 1]
        c, s = math.cos(angle), math.sin(angle)
        for r in range(3):
            x, y, z = tree.rotation[i, r, 0], tree.rotation[i, r, 1], tree.rotation[i, r, 2]
            work.rotation[i, r, 0] = c * x + s * y
            work.rotation[i, r, 1] = c * y - s * x
            work.rotation[i, r, 2] = z
            work.translation[i, r] = tree.translation[i, r] + shift * z


@kernel
def move_links(tree: LinkFrames, dq: FloatArray, ddq: FloatArray, work: LinkMotion) -> None:
    """Spin of each link, its rate, and acceleration of its origin less gravity; links are placed.

    `gradient` is [ω̇]× + [ω]×², so that a point r of a link accelerates by a + gradient r.
    """
    n = dq.shape[0]
    for k in range(3):
        work.acceleration[0, k] = -tree.gravity[k]
    for i in range(1, n + 1):
        u = tree.parent[i]
        rot, p, grad = work.rotation[i], work.translation[i], work.gradient[u]
        b0 = work.acceleration[u, 0] + grad[0, 0] * p[0] + grad[0, 1] * p[1] + grad[0, 2] * p[2]
        b1 = work.acceleration[u, 1] + grad[1, 0] * p[0] + grad[1, 1] * p[1] + grad[1, 2] * p[2]
        b2 = work.acceleration[u, 2] + grad[2, 0] * p[0] + grad[2, 1] * p[1] + grad[2, 2] * p[2]
        a0, a1, a2 = turn_back(rot, b0, b1, b2)
        spin, rate = work.spin[u], work.spin_rate[u]
        w0, w1, w2 = turn_back(rot, spin[0], spin[1], spin[2])
        d0, d1, d2 = turn_back(rot, rate[0], rate[1], rate[2])
        speed = dq[i - 1]
        if tree.revolute[i]:
            d0 += w1 * speed
            d1 -= w0 * speed
            d2 += ddq[i - 1]
            w2 += speed
        else:
            a0 += 2.0 * w1 * speed
            a1 -= 2.0 * w0 * speed
            a2 += ddq[i - 1]
        work.acceleration[i, 0], work.acceleration[i, 1], work.acceleration[i, 2] = a0, a1, a2
        work.spin[i, 0], work.spin[i, 1], work.spin[i, 2] = w0, w1, w2
        work.spin_rate[i, 0], work.spin_rate[i, 1], work.spin_rate[i, 2] = d0, d1, d2
        g = work.gradient[i]
        g[0, 0] = -w1 * w1 - w2 * w2
        g[1, 1] = -w0 * w0 - w2 * w2
        g[2, 2] = -w0 * w0 - w1 * w1
        g[0, 1], g[1, 0] = w0 * w1 - d2, w0 * w1 + d2
        g[0, 2], g[2, 0] = w0 * w2 + d1, w0 * w2 - d1
        g[1, 2], g[2, 1] = w1 * w2 - d0, w1 * w2 + d0
