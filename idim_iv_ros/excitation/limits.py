"""What a motion may use of the robot and what it uses, sample by sample; heights of its frames."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from idim_iv_ros.configuration import Configuration
from idim_iv_ros.errors import DataError, UsageError
from idim_iv_ros.excitation.trajectory import Trajectory
from idim_iv_ros.model import InverseModel, RobotModel
from idim_iv_ros.model.link_motion import link_frames
from idim_iv_ros.simulation import inverse_dynamics, mass_matrix
from idim_iv_ros.types import FloatArray, IntArray

# Where nothing limits the acceleration: half of the torque limit moves the joint's own inertia,
# and full speed takes this long at least.
SHARE_OF_TORQUE = 0.5
SECONDS_TO_FULL_SPEED = 0.1
_SLOWEST, _FASTEST = 1e-6, 1e6  # rad/s² (m/s²): accelerations that may be asked for
_POSTURES = 200
_SEED = 11
_BLOCK = 4000  # samples
_INSIDE = 0.995


@dataclass(frozen=True)
class MotionLimits:
    """Limits of a motion, (n_joints,) each, as the robot has them."""

    lower: FloatArray  # rad (m)
    upper: FloatArray  # rad (m)
    velocity: FloatArray  # rad/s (m/s)
    acceleration: FloatArray  # rad/s² (m/s²)
    torque: FloatArray  # N m (N)
    torque_checked: bool  # Where the nominal model has inertials, so that it predicts torques
    floor: float | None  # Height in the base frame above which every moving frame stays, m
    # Share of each limit that a motion may use; of a position range, about its middle
    margin: float

    @property
    def middle(self) -> FloatArray:
        """Middles of the position ranges (n_joints,), rad (m)."""
        return 0.5 * (self.lower + self.upper)

    @property
    def half_range(self) -> FloatArray:
        """Halves of the position ranges (n_joints,) without margin, rad (m)."""
        return 0.5 * (self.upper - self.lower)

    @property
    def reach(self) -> FloatArray:
        """Distances from the middle (n_joints,) that a motion may go, with margin, rad (m)."""
        return self.margin * self.half_range

    def narrowed(self) -> "MotionLimits":
        """Return what a design aims at: a little less, for what lies between its samples."""
        return replace(self, margin=_INSIDE * self.margin)

    def room(self, posture: FloatArray) -> FloatArray:
        """Distances from a posture (n_joints,) to the nearer ends of the ranges, with margin."""
        return np.asarray(self.reach - np.abs(posture - self.middle))


@dataclass(frozen=True)
class LimitUse:
    """Largest share of each limit that a motion uses, (n_joints,) each; 1 is the limit itself."""

    position: FloatArray  # Distance from the middle of the range over half of the range
    velocity: FloatArray
    acceleration: FloatArray
    # Of the nominal model: gravity, inertia, drives, friction. None without inertials.
    torque: FloatArray | None
    lowest_frame: str
    lowest_height: float  # Of all frames that move, over the whole motion, m

    def within(self, limits: MotionLimits) -> bool:
        """Whether no share exceeds the margin and every frame stays above the floor."""
        shares = [self.position, self.velocity, self.acceleration]
        shares += [] if self.torque is None else [self.torque]
        over_floor = limits.floor is None or self.lowest_height > limits.floor
        return over_floor and bool(np.max(shares) <= limits.margin * (1.0 + 1e-9))


def limit_use(robot: RobotModel, limits: MotionLimits, motion: Trajectory) -> LimitUse:
    """How much of the limits a motion uses, over all of its samples."""
    frames = moving_frames(robot)
    blocks = [slice(s, s + _BLOCK) for s in range(0, len(motion.position), _BLOCK)]
    lowest = np.min([frames.heights(motion.position[b]).min(axis=0) for b in blocks], axis=0)
    frame = int(np.argmin(lowest))
    torque = None
    if limits.torque_checked:
        predicted = inverse_dynamics(robot, robot.given, *motion.signals)
        torque = np.abs(predicted).max(axis=0) / limits.torque
    return LimitUse(
        position=np.abs(motion.position - limits.middle).max(axis=0) / limits.half_range,
        velocity=np.abs(motion.velocity).max(axis=0) / limits.velocity,
        acceleration=np.abs(motion.acceleration).max(axis=0) / limits.acceleration,
        torque=torque,
        lowest_frame=frames.names[frame],
        lowest_height=float(lowest[frame]),
    )


def use_within(robot: RobotModel, limits: MotionLimits, motion: Trajectory) -> LimitUse:
    """Return what a finished motion uses.

    Raises DataError: a sample of it breaks a limit.
    """
    use = limit_use(robot, limits, motion)
    if not use.within(limits):
        raise DataError("no motion within the limits was found: a limit broke at full rate")
    return use


def motion_limits(
    model: InverseModel,
    configuration: Configuration,
    *,
    margin: float = 0.9,
    acceleration: Sequence[float] | None = None,
    floor: float | None = None,
) -> MotionLimits:
    """Gather the limits of the URDF, the configuration and the request.

    The torque limit is the smaller of the URDF's effort and ``controller.torque_limit``. A
    revolute joint without position limits gets ±π. Without `acceleration`, a joint may take
    half of its torque limit over the mean of its diagonal element of the mass matrix (nominal
    model, 200 postures), and at most what reaches its full speed in 0.1 s.

    - `margin`: share of each limit that may be used, above 0 and up to 1
    - `acceleration`: one value for all joints or one for each, rad/s² (m/s²)
    - `floor`: height in the base frame, m

    Raises UsageError: a joint without a limit that is needed, or a value outside its range.
    """
    robot = model.robot
    if not 0.0 < margin <= 1.0:
        raise UsageError(f"margin {margin:g}: a share above 0 and up to 1 is needed")
    if floor is not None and not np.isfinite(floor):
        raise UsageError(f"floor {floor:g}: a height in m is needed")
    lower, upper, velocity = robot.limits.lower, robot.limits.upper, robot.limits.velocity
    unlimited = ~(np.isfinite(lower) & np.isfinite(upper))
    slides = unlimited & np.equal(robot.joint_types, "prismatic")
    if slides.any():
        raise UsageError(
            f"joint {robot.joints[int(np.argmax(slides))]} has no position limits: a prismatic "
            "joint needs <limit lower upper> in the URDF"
        )
    lower, upper = np.where(unlimited, -np.pi, lower), np.where(unlimited, np.pi, upper)
    torque = np.where(robot.limits.effort > 0.0, robot.limits.effort, np.inf)
    if configuration.controller.torque_limit is not None:
        torque = np.minimum(torque, configuration.controller.torque_limit)
    effort = "<limit effort> of the URDF or controller.torque_limit"
    for values, what, where in (
        (velocity, "velocity", "<limit velocity> of the URDF"),
        (torque, "effort", effort),
    ):
        lacking = ~(np.isfinite(values) & (values > 0.0))
        if lacking.any():
            joint = robot.joints[int(np.argmax(lacking))]
            raise UsageError(f"joint {joint} has no {what} limit: give {where}")
    joints = len(robot.joints)
    allowed = velocity / SECONDS_TO_FULL_SPEED
    if acceleration is not None:
        if len(acceleration) not in (1, joints):
            raise UsageError(f"acceleration has {len(acceleration)} values for {joints} joints")
        if not all(_SLOWEST <= value <= _FASTEST for value in acceleration):
            raise UsageError(
                f"acceleration: positive values from {_SLOWEST:g} to {_FASTEST:g} rad/s² (m/s²) "
                "are needed"
            )
        allowed = np.broadcast_to(np.array(acceleration, dtype=float), (joints,)).copy()
    elif robot.has_inertials:
        postures = np.random.default_rng(_SEED).uniform(lower, upper, (_POSTURES, joints))
        mass = mass_matrix(robot, robot.given, postures)
        inertia = np.mean(np.diagonal(mass, axis1=1, axis2=2), axis=0)
        allowed = np.minimum(allowed, SHARE_OF_TORQUE * torque / np.maximum(inertia, 1e-9))
    return MotionLimits(
        lower=lower,
        upper=upper,
        velocity=velocity,
        acceleration=allowed,
        torque=torque,
        torque_checked=robot.has_inertials,
        floor=floor,
        margin=margin,
    )


def require_inside(start: FloatArray, limits: MotionLimits, joints: tuple[str, ...]) -> None:
    """Refuse a start posture (n_joints,) that leaves no room within the position limits.

    Raises UsageError: one line: wrong length, or the first joint outside its limits with the
    margin.
    """
    if len(start) != len(joints):
        raise UsageError(f"start has {len(start)} values for {len(joints)} joints")
    for joint, value, middle, room in zip(joints, start, limits.middle, limits.reach, strict=True):
        if not abs(value - middle) < room:
            raise UsageError(
                f"start of joint {joint}, {value:g}, lies outside {middle - room:.4g} to "
                f"{middle + room:.4g} (its limits with the margin)"
            )


@dataclass(frozen=True)
class MovingFrames:
    """Origins of links, joints and end-effector that the identified joints move."""

    robot: RobotModel
    names: tuple[str, ...]
    joints: IntArray  # (f,): joint of the tree (pinocchio, from 1) that a frame is fixed to
    offsets: FloatArray  # (f, 3) m: origin of each frame in the frame of its joint
    axes: FloatArray  # (n_joints, 3): axis of each joint of the tree, in its own frame

    def heights(self, q: FloatArray) -> FloatArray:
        """Heights in the base frame (n_samples, f) m at positions (n_samples, n_joints)."""
        model, samples = self.robot.pinocchio, len(q)
        turns = np.broadcast_to(np.eye(3), (model.njoints, samples, 3, 3)).copy()
        origins = np.zeros((model.njoints, samples, 3))
        for i in range(1, model.njoints):
            parent, place = model.parents[i], model.jointPlacements[i]
            joint = self.robot.order[i - 1]
            moved = q[:, joint, None] * self.axes[i - 1]
            turns[i] = turns[parent] @ place.rotation
            origins[i] = origins[parent] + turns[parent] @ place.translation
            if self.robot.joint_types[joint] == "revolute":
                turns[i] = turns[i] @ Rotation.from_rotvec(moved).as_matrix()
            else:
                origins[i] += (turns[i] @ moved[:, :, None])[:, :, 0]
        heights = np.einsum("fsj,fj->fs", turns[self.joints, :, 2], self.offsets)
        return np.asarray((origins[self.joints, :, 2] + heights).T)


def moving_frames(robot: RobotModel) -> MovingFrames:
    """Collect the origins of all frames (links, joints, end-effector) that a joint moves."""
    frames = [frame for frame in robot.pinocchio.frames if frame.parentJoint > 0]
    return MovingFrames(
        robot=robot,
        names=tuple(frame.name for frame in frames),
        joints=np.array([frame.parentJoint for frame in frames], dtype=np.int64),
        offsets=np.array([frame.placement.translation for frame in frames]).reshape(-1, 3),
        axes=link_frames(robot).turned[1:, :, 2],
    )


def require_reachable(frames: MovingFrames, limits: MotionLimits) -> None:
    """Refuse a floor that none of 2,000 random postures within the limits keeps above.

    Raises UsageError: the frame that is in the way, and the highest floor that is possible.
    """
    if limits.floor is None:
        return
    random = np.random.default_rng(5)
    lower, upper = limits.middle - limits.reach, limits.middle + limits.reach
    height = frames.heights(random.uniform(lower, upper, (2000, len(lower))))
    highest = height.max(axis=0)
    low = int(np.argmin(highest))
    if highest[low] <= limits.floor:
        raise UsageError(
            f"floor {limits.floor:g} m cannot be kept: frame {frames.names[low]} rises to "
            f"{highest[low]:.3g} m at most"
        )
    best = float(height.min(axis=1).max())
    if best <= limits.floor:
        raise UsageError(
            f"floor {limits.floor:g} m cannot be kept: in the best of 2,000 postures the lowest "
            f"frame is at {best:.3g} m"
        )
