"""All servos of a robot at once: what its rigid bodies ask along a motion, and their fit."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from idim_iv_ros.model.robot import RobotModel
from idim_iv_ros.servo.fit import (
    PARAMETERS,
    DriveEstimate,
    Sampled,
    block_covariance,
    block_labels,
    followed,
)
from idim_iv_ros.servo.loop_kernel import Drive, Load
from idim_iv_ros.simulation.rigid_body import inverse_dynamics, mass_matrix
from idim_iv_ros.types import FloatArray

_FINE = 200.0  # Hz, least rate of what the rigid bodies ask
_STEP = 1e-4  # rad, of the slope of a torque with its joint's position
_ITERATIONS, _HALVINGS = 6, 3
_ENOUGH = 1e-3  # share by which the cost must fall for another iteration
_DIFFERENCE = 0.2  # standard deviations
Trajectory = FloatArray  # (3, n_samples, n_joints) rad, rad/s, rad/s²


@dataclass(frozen=True)
class Motion(Sampled):
    """One recording of all joints."""

    name: str
    gain: float = 1.0  # Of the loops, in parts of that for which K is asked
    robot: RobotModel | None = None  # What carried the load; None: the robot of the configuration

    @property
    def finer(self) -> int:
        """Samples of what the rigid bodies ask in one of the recording."""
        return max(int(np.ceil(_FINE / self.rate - 1e-6)), 1)


@dataclass(frozen=True)
class RigidLoad:
    """What the rigid bodies ask of all joints along a motion."""

    mass: FloatArray  # (n_samples, n_joints, n_joints) kg m²
    # bias, slope: (n_samples, n_joints): Torque without any acceleration, N m, and its slope
    # with the joint's position, N m/rad
    bias: FloatArray
    slope: FloatArray
    # (3, n_samples, n_joints): The motion along which they hold, rad, rad/s, rad/s²
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

        - `drives`: (n_joints, 8), as `Drive`
        """
        rate = motion.rate * motion.finer
        load = (self.mass, self.bias, self.slope, self.trajectory[0])
        command = np.repeat(motion.command, motion.finer, axis=0)
        position, speed = followed(drives, load, command, rate, motion.gain, motion.position[0])
        # Of the speeds: what acts between two samples is the mean acceleration there.
        return np.stack([position, speed, np.gradient(speed, 1.0 / rate, axis=0)])


def finer_motion(motion: tuple[FloatArray, FloatArray, FloatArray], factor: int) -> Trajectory:
    """Return a sampled motion (n_samples, n_joints) at a multiple of its rate, by cubic splines."""
    stacked = np.stack(motion)
    if factor == 1:
        return stacked
    samples = stacked.shape[1]
    place = np.minimum(np.arange(samples * factor) / factor, samples - 1.0)
    spline = scipy.interpolate.make_interp_spline(np.arange(samples), stacked, k=3, axis=1)
    return np.asarray(spline(place))


def fit_robot(
    motions: Sequence[Motion],
    loads: Sequence[RigidLoad],
    robot: RobotModel,
    estimates: Sequence[DriveEstimate],
) -> tuple[list[DriveEstimate], list[RigidLoad]]:
    """Improve estimates that were made joint by joint.

    Sensitivities are taken once; the rigid bodies' torques are taken again along the motion of
    every iteration. Joints are weighted by their residuals.

    Returns
    -------
    estimates, loads
        Loads along the last simulated motion.
    """
    drives = np.array([estimate.drive for estimate in estimates])
    spread = np.sqrt([np.diag(estimate.covariance) for estimate in estimates])
    places = np.argwhere(spread > 0.0)
    low = np.array([-np.inf if PARAMETERS[k] == "offset" else 0.0 for _, k in places])
    current = list(loads)
    residual = _residual(motions, current, drives)
    weights = _weights(motions, residual)
    columns = []
    for joint, k in places:
        step = _DIFFERENCE * spread[joint, k]
        moved = drives.copy()
        moved[joint, k] += step
        columns.append((residual - _residual(motions, current, moved)) / step)
    slopes = np.column_stack(columns)
    cost = float(residual @ (weights * residual))
    for _ in range(_ITERATIONS):
        weighted = slopes * weights[:, None]
        change = np.linalg.lstsq(weighted.T @ slopes, weighted.T @ residual, rcond=1e-12)[0]
        for halving in range(_HALVINGS):
            trial = drives.copy()
            values = drives[tuple(places.T)] + change * 0.5**halving
            trial[tuple(places.T)] = np.maximum(values, low)
            simulated = [
                load.simulated(trial, motion) for load, motion in zip(current, motions, strict=True)
            ]
            if not np.isfinite(np.concatenate(simulated, axis=1)).all():
                continue
            along = [
                RigidLoad.along(motion.robot or robot, trajectory)
                for motion, trajectory in zip(motions, simulated, strict=True)
            ]
            left = _residual(motions, along, trial)
            if float(left @ (weights * left)) < cost:
                break
        else:
            break
        fallen = 1.0 - float(left @ (weights * left)) / cost
        # Broyden: what the step showed of the sensitivities.
        taken = trial[tuple(places.T)] - drives[tuple(places.T)]
        scaled = taken / spread[tuple(places.T)]
        missed = (residual - left) - slopes @ taken
        slopes = slopes + np.outer(missed, scaled / spread[tuple(places.T)]) / (scaled @ scaled)
        drives, current, residual = trial, along, left
        cost *= 1.0 - fallen
        if fallen < _ENOUGH:
            break
    weights = _weights(motions, residual)
    root = np.sqrt(weights)
    labels = np.concatenate(
        [
            np.repeat(label[:, None], drives.shape[0], axis=1)[motion.used]
            for label, motion in zip(block_labels(motions), motions, strict=True)
        ]
    )
    covariance, blocks = block_covariance(labels, root * residual, root[:, None] * slopes)
    owner = np.concatenate([np.argwhere(motion.used)[:, 1] for motion in motions])
    improved = []
    for joint in range(len(drives)):
        mine = places[:, 0] == joint
        whole = np.zeros((len(PARAMETERS), len(PARAMETERS)))
        whole[np.ix_(places[mine, 1], places[mine, 1])] = covariance[np.ix_(mine, mine)]
        rms = float(np.sqrt(np.mean(residual[owner == joint] ** 2)))
        improved.append(DriveEstimate(Drive(*drives[joint]), whole, rms, blocks))
    return improved, current


def _residual(
    motions: Sequence[Motion], loads: Sequence[RigidLoad], drives: FloatArray
) -> FloatArray:
    """Measured less simulated positions of all joints where they are compared, (n,) rad."""
    parts = []
    for motion, load in zip(motions, loads, strict=True):
        simulated = load.simulated(drives, motion)[0, :: motion.finer]
        parts.append((motion.position - simulated)[motion.used])
    return np.concatenate(parts)


def _weights(motions: Sequence[Motion], residual: FloatArray) -> FloatArray:
    """One over the mean square of the residuals of a value's joint, (n,)."""
    owner = np.concatenate([np.argwhere(motion.used)[:, 1] for motion in motions])
    square = np.bincount(owner, residual**2) / np.maximum(np.bincount(owner), 1)
    return np.asarray(1.0 / np.maximum(square[owner], 1e-18))
