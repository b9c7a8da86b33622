"""What a motion uses of each limit, sample by sample: the check before anything is written."""

from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from idim_iv_ros.errors import UsageError
from idim_iv_ros.excitation.limits import MotionLimits
from idim_iv_ros.excitation.trajectory import Trajectory
from idim_iv_ros.model import RobotModel
from idim_iv_ros.simulation import inverse_dynamics
from idim_iv_ros.types import FloatArray

_BLOCK = 4000


@dataclass(frozen=True)
class MovingFrames:
    """Origins of links, joints and end-effector that the identified joints move.

    Attributes
    ----------
    robot : RobotModel
    names : tuple of str
    joints : (f,) int
        Joint of the tree (pinocchio, from 1) that each frame is fixed to.
    offsets : (f, 3) m
        Origin of each frame in the frame of its joint.
    axes : (n_joints, 3)
        Axis of each joint of the tree, in its own frame.
    """

    robot: RobotModel
    names: tuple[str, ...]
    joints: NDArray[np.int64]
    offsets: FloatArray
    axes: FloatArray

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
        held = np.einsum("fsij,fj->fsi", turns[self.joints], self.offsets)
        return origins[self.joints] + held, origins, axes

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


@dataclass(frozen=True)
class LimitUse:
    """Largest share of each limit that a motion uses, (n_joints,) each; 1 is the limit itself.

    Attributes
    ----------
    position
        Distance from the middle of the range over half of the range.
    velocity, acceleration
    torque : or None
        Of the nominal model: gravity, inertia, drives, friction. None without inertials.
    lowest_frame : str
    lowest_height : float
        Of all frames that move, over the whole motion, m.
    """

    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    torque: FloatArray | None
    lowest_frame: str
    lowest_height: float

    def within(self, limits: MotionLimits) -> bool:
        """Whether no share exceeds the margin and every frame stays above the floor."""
        shares = [self.position, self.velocity, self.acceleration]
        shares += [] if self.torque is None else [self.torque]
        above = limits.floor is None or self.lowest_height > limits.floor
        return above and bool(np.max(shares) <= limits.margin * (1.0 + 1e-9))


def limit_use(
    robot: RobotModel, limits: MotionLimits, frames: MovingFrames, motion: Trajectory
) -> LimitUse:
    """Look at every sample of a motion."""
    blocks = [slice(s, s + _BLOCK) for s in range(0, len(motion.position), _BLOCK)]
    lowest = np.min([frames.heights(motion.position[b]).min(axis=0) for b in blocks], axis=0)
    frame = int(np.argmin(lowest))
    torque = None
    if limits.torque_known:
        predicted = inverse_dynamics(
            robot, robot.given, motion.position, motion.velocity, motion.acceleration
        )
        torque = np.abs(predicted).max(axis=0) / limits.torque
    return LimitUse(
        position=np.abs(motion.position - limits.middle).max(axis=0) / limits.half_range,
        velocity=np.abs(motion.velocity).max(axis=0) / limits.velocity,
        acceleration=np.abs(motion.acceleration).max(axis=0) / limits.acceleration,
        torque=torque,
        lowest_frame=frames.names[frame],
        lowest_height=float(lowest[frame]),
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
