"""What a motion uses of each limit, sample by sample: the check before anything is written."""

from dataclasses import dataclass

import numpy as np

from idim_iv_ros.excitation.heights import MovingFrames
from idim_iv_ros.excitation.limits import MotionLimits
from idim_iv_ros.excitation.trajectory import Trajectory
from idim_iv_ros.model import RobotModel
from idim_iv_ros.simulation import inverse_dynamics
from idim_iv_ros.types import FloatArray

_BLOCK = 4000


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
