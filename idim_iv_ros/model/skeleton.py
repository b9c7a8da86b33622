"""Where the joints of a robot are in space, to draw it."""

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from idim_iv_ros.model.link_motion import link_frames
from idim_iv_ros.model.robot import RobotModel
from idim_iv_ros.types import FloatArray, IntArray

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
