"""Placement and motion of the links of a robot: compiled, for its torques and its regressor.

`skeleton` says where the joints are in space, to draw the robot.

Source: Khalil and Dombre, Modeling, Identification and Control of Robots, chapter 9 (recursive
Newton-Euler linear in the parameters).
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from idim_iv_ros.compilation import kernel
from idim_iv_ros.model.robot import RobotModel
from idim_iv_ros.types import BoolArray, FloatArray, IntArray

Vector = tuple[float, float, float]


class LinkFrames(NamedTuple):
    """Kinematic tree with joints numbered from 1 in its order, as in pinocchio; 0 is the base."""

    parent: IntArray  # (n + 1,)
    revolute: BoolArray  # (n + 1,)
    rotation: FloatArray  # (n + 1, 3, 3): constant, of a turned frame in its parent's
    translation: FloatArray  # (n + 1, 3): likewise
    # (n + 1, 3, 3): from the turned frame to pinocchio's, which inertial parameters are given in
    turned: FloatArray
    gravity: FloatArray  # (3,) m/s², in the base


def link_frames(robot: RobotModel) -> LinkFrames:
    """Shape the kinematics of a robot for compiled code."""
    model, types = robot.pinocchio, np.array(robot.joint_types)
    data = model.createData()
    pin.computeJointJacobians(model, data, pin.neutral(model))
    turned = np.tile(np.eye(3), (model.njoints, 1, 1))
    rotation, translation = np.zeros((model.njoints, 3, 3)), np.zeros((model.njoints, 3))
    for joint in range(1, model.njoints):
        jacobian = pin.getJointJacobian(model, data, joint, pin.ReferenceFrame.LOCAL)
        motion = jacobian.reshape(6, -1)[:, model.joints[joint].idx_v]
        axis = motion[3:] if np.linalg.norm(motion[3:]) > 0.5 else motion[:3]
        if axis[2] != 1.0:
            x = np.cross(np.eye(3)[np.argmin(np.abs(axis))], axis)
            x /= np.linalg.norm(x)
            turned[joint] = np.column_stack([x, np.cross(axis, x), axis])
        parent, placement = turned[model.parents[joint]], model.jointPlacements[joint]
        rotation[joint] = parent.T @ placement.rotation @ turned[joint]
        translation[joint] = parent.T @ placement.translation
    return LinkFrames(
        parent=np.array(list(model.parents), dtype=np.int64),
        revolute=np.append(False, types[robot.order] == "revolute"),
        rotation=rotation,
        translation=translation,
        turned=turned,
        gravity=np.array(model.gravity.linear, dtype=float),
    )


class LinkMotion(NamedTuple):
    """Placement of every link in its parent, spin, and motion of its origin; row 0: the base."""

    rotation: FloatArray  # (n + 1, 3, 3)
    gradient: FloatArray  # (n + 1, 3, 3)
    translation: FloatArray  # (n + 1, 3), as the next three
    spin: FloatArray
    spin_rate: FloatArray
    acceleration: FloatArray


def empty_motion(joints: int) -> LinkMotion:
    """Allocate the arrays for a robot of so many joints."""
    matrices, vectors = np.zeros((2, joints + 1, 3, 3)), np.zeros((4, joints + 1, 3))
    return LinkMotion._make([*matrices, *vectors])


@kernel
def turn(rotation: FloatArray, x: float, y: float, z: float) -> Vector:
    """Product of a rotation (its `T`: of the inverse) and a vector."""
    return (
        rotation[0, 0] * x + rotation[0, 1] * y + rotation[0, 2] * z,
        rotation[1, 0] * x + rotation[1, 1] * y + rotation[1, 2] * z,
        rotation[2, 0] * x + rotation[2, 1] * y + rotation[2, 2] * z,
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
        a0, a1, a2 = turn(rot.T, b0, b1, b2)
        spin, rate = work.spin[u], work.spin_rate[u]
        w0, w1, w2 = turn(rot.T, spin[0], spin[1], spin[2])
        d0, d1, d2 = turn(rot.T, rate[0], rate[1], rate[2])
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


# Of half of a revolute joint's range, and at most, rad: a bent arm is easier to recognise than one
# that is stretched out.
_BEND, _MOST_BEND = 0.3, 0.6


@dataclass(frozen=True)
class Skeleton:
    """Joints and ends of a robot in one posture, m in the base frame."""

    origins: FloatArray  # (n_joints, 3): origin of each joint, in the order of the configuration
    # (n_joints, 3): unit vector along which each joint moves or about which it turns
    axes: FloatArray
    parents: IntArray  # (n_joints,) int: joint that carries each joint; -1 for the base
    links: tuple[str, ...]  # Link that each joint moves
    # Joints that carry no other, with the frame on them that is farthest away
    ends: tuple[tuple[int, FloatArray], ...]

    @property
    def segments(self) -> list[tuple[FloatArray, FloatArray]]:
        """Lines (start, end), (3,) each, from the base over every joint to the ends."""
        lines = [
            (np.zeros(3) if parent < 0 else self.origins[parent], self.origins[joint])
            for joint, parent in enumerate(self.parents)
        ]
        return lines + [(self.origins[joint], end) for joint, end in self.ends]


def skeleton(robot: RobotModel) -> Skeleton:
    """Return the joints in the middle of their ranges, revolute ones a little bent."""
    lower, upper = robot.limits.lower, robot.limits.upper
    limited = np.isfinite(lower) & np.isfinite(upper)
    lower, upper = np.where(limited, lower, -np.pi), np.where(limited, upper, np.pi)
    middle, half = 0.5 * (lower + upper), 0.5 * (upper - lower)
    revolute = np.equal(robot.joint_types, "revolute")
    sign = np.where(np.arange(len(middle)) % 2 == 0, 1.0, -1.0)
    posture = middle + sign * np.where(revolute, np.minimum(_BEND * half, _MOST_BEND), 0.0)
    model = robot.pinocchio
    data = model.createData()
    pin.framesForwardKinematics(model, data, posture[robot.order])
    # Joints of the tree are numbered from 1, in another order than those of the configuration.
    tree = (np.argsort(robot.order) + 1).tolist()
    turned = link_frames(robot).turned
    origins = np.array([data.oMi[joint].translation for joint in tree])
    axes = np.array([data.oMi[joint].rotation @ turned[joint][:, 2] for joint in tree])
    carriers = [int(model.parents[joint]) for joint in tree]
    parents = np.array([tree.index(carrier) if carrier else -1 for carrier in carriers])
    links, ends = [], []
    for place, joint in enumerate(tree):
        frames = [(k, frame) for k, frame in enumerate(model.frames) if frame.parentJoint == joint]
        bodies = (str(frame.name) for _, frame in frames if frame.type == pin.FrameType.BODY)
        links.append(next(bodies, ""))
        if place not in parents:
            points = np.array([data.oMf[k].translation for k, _ in frames])
            far = int(np.argmax(np.linalg.norm(points - origins[place], axis=1)))
            ends.append((place, points[far]))
    return Skeleton(origins, axes, parents, tuple(links), tuple(ends))
