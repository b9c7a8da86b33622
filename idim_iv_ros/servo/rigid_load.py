"""What the rigid bodies of a robot ask of its joints along a motion, and the motion they allow."""

from dataclasses import dataclass

import numpy as np
import scipy

from idim_iv_ros.model.robot import RobotModel
from idim_iv_ros.servo.fit import STARTING, steps_of
from idim_iv_ros.servo.loop_kernel import Load, simulate_joints
from idim_iv_ros.simulation.rigid_body import inverse_dynamics, mass_matrix
from idim_iv_ros.types import BoolArray, FloatArray

_FINE = 200.0  # Hz, least rate of what the rigid bodies ask
_STEP = 1e-4  # rad, of the slope of a torque with its joint's position
Trajectory = FloatArray  # (3, n_samples, n_joints) rad, rad/s, rad/s²


@dataclass(frozen=True)
class Motion:
    """One recording of all joints.

    Attributes
    ----------
    name : str
    rate : float
        Hz.
    command, position : (n_samples, n_joints) rad
    valid : (n_samples, n_joints) bool
    gain : float
        Of the loops, in parts of that for which K is asked.
    robot : RobotModel or None
        What carried the load; None: the robot of the configuration.
    """

    name: str
    rate: float
    command: FloatArray
    position: FloatArray
    valid: BoolArray
    gain: float = 1.0
    robot: RobotModel | None = None

    @property
    def finer(self) -> int:
        """Samples of what the rigid bodies ask in one of the recording."""
        return max(int(np.ceil(_FINE / self.rate - 1e-6)), 1)

    @property
    def used(self) -> BoolArray:
        """Samples (n_samples, n_joints) that are compared."""
        used = self.valid.copy()
        used[: int(np.ceil(STARTING * self.rate))] = False
        return used


@dataclass(frozen=True)
class RigidLoad:
    """What the rigid bodies ask of all joints along a motion.

    Attributes
    ----------
    mass : (n_samples, n_joints, n_joints) kg m²
    bias, slope : (n_samples, n_joints)
        Torque without any acceleration, N m, and its slope with the joint's position, N m/rad.
    trajectory : (3, n_samples, n_joints)
        The motion along which they hold, rad, rad/s, rad/s².
    """

    mass: FloatArray
    bias: FloatArray
    slope: FloatArray
    trajectory: Trajectory

    @classmethod
    def along(cls, robot: RobotModel, trajectory: Trajectory) -> "RigidLoad":
        """Return what the nominal rigid bodies of a robot ask, without drives and friction."""
        position, velocity, _ = trajectory
        bodies, rest = robot.given.of_links, np.zeros_like(position)
        bias = inverse_dynamics(robot, bodies, position, velocity, rest)
        slope = np.empty_like(bias)
        for joint in range(position.shape[1]):
            moved = position.copy()
            moved[:, joint] += _STEP
            there = inverse_dynamics(robot, bodies, moved, velocity, rest)[:, joint]
            slope[:, joint] = (there - bias[:, joint]) / _STEP
        return cls(mass_matrix(robot, bodies, position), bias, slope, trajectory)

    def of_joint(self, joint: int) -> Load:
        """Load of one joint, the others moving along the trajectory."""
        accelerations = self.trajectory[2].copy()
        accelerations[:, joint] = 0.0
        coupled = np.einsum("sk,sk->s", self.mass[:, joint], accelerations)
        columns = (
            self.mass[:, joint, joint],
            self.bias[:, joint] + coupled,
            self.slope[:, joint],
            self.trajectory[0][:, joint],
        )
        return Load(*(np.ascontiguousarray(column) for column in columns))

    def simulated(self, drives: FloatArray, motion: Motion) -> Trajectory:
        """Motion (3, n_samples · finer, n_joints) of all joints with their servos.

        Parameters
        ----------
        drives
            (n_joints, 8), as `Drive`.
        """
        rate = motion.rate * motion.finer
        command = np.ascontiguousarray(np.repeat(motion.command, motion.finer, axis=0))
        trajectory = np.empty((3, *command.shape))
        state = np.zeros((6, command.shape[1]))
        state[0] = motion.position[0]
        position = np.ascontiguousarray(self.trajectory[0])
        simulate_joints(
            drives,
            self.mass,
            self.bias,
            self.slope,
            position,
            command,
            rate,
            motion.gain,
            steps_of(rate),
            state,
            trajectory,
        )
        # Of the speeds: what acts between two samples is the mean acceleration there.
        trajectory[2] = np.gradient(trajectory[1], 1.0 / rate, axis=0)
        return trajectory


def finer_motion(motion: tuple[FloatArray, FloatArray, FloatArray], factor: int) -> Trajectory:
    """Return a sampled motion (n_samples, n_joints) at a multiple of its rate, by cubic splines."""
    stacked = np.stack(motion)
    if factor == 1:
        return stacked
    samples = stacked.shape[1]
    place = np.minimum(np.arange(samples * factor) / factor, samples - 1.0)
    spline = scipy.interpolate.make_interp_spline(np.arange(samples), stacked, k=3, axis=1)
    return np.asarray(spline(place))
