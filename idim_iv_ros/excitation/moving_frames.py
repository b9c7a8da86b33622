"""Heights of all that a motion moves: links, joints and end-effector."""

from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from idim_iv_ros.errors import UsageError
from idim_iv_ros.model import RobotModel
from idim_iv_ros.types import FloatArray


@dataclass(frozen=True)
class MovingFrames:
    """Origins of links, joints and end-effector that the identified joints move."""

    robot: RobotModel
    names: tuple[str, ...]
    # (f,) int: joint of the tree (pinocchio, from 1) that each frame is fixed to
    joints: NDArray[np.int64]
    offsets: FloatArray  # (f, 3) m: origin of each frame in the frame of its joint
    axes: FloatArray  # (n_joints, 3): axis of each joint of the tree, in its own frame

    def heights(self, q: FloatArray) -> FloatArray:
        """Heights in the base frame (n_samples, f) m at positions (n_samples, n_joints)."""
        return self._places(q)[0][:, :, 2].T

    def heights_and_slopes(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Heights, and their derivatives (n_samples, f, n_joints) m/rad (m/m)."""
        points, origins, axes = self._places(q)
        slope = np.zeros((len(q), len(self.joints), len(self.robot.joints)))
        for frame, joint in enumerate(self.joints):
            for ancestor in list(self.robot.pinocchio.supports[int(joint)])[1:]:
                lever, axis = points[frame] - origins[ancestor], axes[ancestor]
                slope[:, frame, self.robot.order[ancestor - 1]] = (
                    axis[:, 0] * lever[:, 1] - axis[:, 1] * lever[:, 0]
                    if self._revolute(ancestor)
                    else axis[:, 2]
                )
        return points[:, :, 2].T, slope

    def _places(self, q: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Origins of the frames (f, n_samples, 3), and origins and axes of the joints."""
        model, samples = self.robot.pinocchio, len(q)
        turns = np.broadcast_to(np.eye(3), (model.njoints, samples, 3, 3)).copy()
        origins, axes = np.zeros((2, model.njoints, samples, 3))
        for i in range(1, model.njoints):
            parent, place = model.parents[i], model.jointPlacements[i]
            axis, coordinate = self.axes[i - 1], q[:, self.robot.order[i - 1]]
            fixed = turns[parent] @ place.rotation
            origins[i] = origins[parent] + turns[parent] @ place.translation
            axes[i] = fixed @ axis
            if self._revolute(i):
                turns[i] = fixed @ _rotation(axis, coordinate)
            else:
                turns[i] = fixed
                origins[i] += coordinate[:, None] * axes[i]
        frames_of_joint = np.einsum("fsij,fj->fsi", turns[self.joints], self.offsets)
        return origins[self.joints] + frames_of_joint, origins, axes

    def _revolute(self, tree: int) -> bool:
        return self.robot.joint_types[int(self.robot.order[tree - 1])] == "revolute"


def moving_frames(robot: RobotModel) -> MovingFrames:
    """Collect the origins of all frames (links, joints, end-effector) that a joint moves."""
    data = robot.pinocchio.createData()
    frames = [frame for frame in robot.pinocchio.frames if frame.parentJoint > 0]
    return MovingFrames(
        robot=robot,
        names=tuple(frame.name for frame in frames),
        joints=np.array([frame.parentJoint for frame in frames], dtype=np.int64),
        offsets=np.array([frame.placement.translation for frame in frames]).reshape(-1, 3),
        axes=np.array([_axis(data, tree + 1) for tree in range(len(robot.joints))]),
    )


def require_reachable(
    frames: MovingFrames, floor: float, lower: FloatArray, upper: FloatArray
) -> None:
    """Refuse a floor that no posture keeps above.

    Looks at 2,000 random postures, and at frames whose height no joint changes.

    Raises
    ------
    UsageError
        One line: the frame that is in the way, and the highest floor that is possible.
    """
    random = np.random.default_rng(5)
    height = frames.heights(random.uniform(lower, upper, (2000, len(lower))))
    highest = height.max(axis=0)
    low = int(np.argmin(highest))
    if highest[low] <= floor:
        raise UsageError(
            f"floor {floor:g} m cannot be kept: frame {frames.names[low]} rises to "
            f"{highest[low]:.3g} m at most"
        )
    best = float(height.min(axis=1).max())
    if best <= floor:
        raise UsageError(
            f"floor {floor:g} m cannot be kept: in the best of 2,000 postures the lowest frame "
            f"is at {best:.3g} m"
        )


def _axis(data: pin.Data, tree: int) -> FloatArray:
    subspace = np.asarray(data.joints[tree].S).ravel()
    return np.asarray(subspace[3:] if np.any(subspace[3:]) else subspace[:3])


def _rotation(axis: FloatArray, angle: FloatArray) -> FloatArray:
    """Rodrigues' formula: (n_samples, 3, 3)."""
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    sine, versine = np.sin(angle)[:, None, None], (1.0 - np.cos(angle))[:, None, None]
    return np.asarray(np.eye(3) + sine * cross + versine * (cross @ cross))
