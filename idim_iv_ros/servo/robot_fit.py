"""All servos of a robot at once: what its rigid bodies ask along a motion, and their fit."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from idim_iv_ros.model.robot import RobotModel
from idim_iv_ros.servo.fit import (
    PARAMETERS,
    DriveEstimate,
    Run,
    Sampled,
    block_covariance,
    block_labels,
    fit_drive,
    followed,
    ordinary_least_squares,
    scales,
    smooth_motion,
)
from idim_iv_ros.servo.loop_kernel import Drive, Load
from idim_iv_ros.simulation.rigid_body import inverse_dynamics, mass_matrix
from idim_iv_ros.types import FloatArray

_FINE = 200.0  # Hz, least rate of what the rigid bodies ask
_STEP = 1e-4  # rad, of the slope of a torque with its joint's position
_ITERATIONS, _HALVINGS = 6, 3
_ENOUGH = 1e-3  # share by which the cost must fall for another iteration
_DIFFERENCE = 0.2  # standard deviations
_TURNS = 2  # of the fits joint by joint
_COARSE = 8  # iterations
_ROUGH = 1e-3  # share of the cost, of a fit that another one follows
_ALWAYS = PARAMETERS[:6]
_LOAD_FRICTION = 0.1  # where the search for it begins
_LIMITS = (0.8, 0.4)  # of the largest command error: where the search for a limit begins
LARGEST_ANGLE = 12.0  # rad, beyond which no limited joint turns
Trajectory = FloatArray  # (3, n_samples, n_joints) rad, rad/s, rad/s²


@dataclass(frozen=True)
class Motion(Sampled):
    """Commands and positions of all joints in a recording."""

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

    Returns estimates, and loads along the last simulated motion.
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
    """Weights (n,) of residuals: one over the mean square of all those of their joint."""
    owner = np.concatenate([np.argwhere(motion.used)[:, 1] for motion in motions])
    square = np.bincount(owner, residual**2) / np.maximum(np.bincount(owner), 1)
    return np.asarray(1.0 / np.maximum(square[owner], 1e-18))


def fit_servos(
    motions: Sequence[Motion], robot: RobotModel
) -> list[tuple[list[Run], DriveEstimate]]:
    """Fit the servos of all joints to all motions.

    Joint by joint first, with what the others do taken from the measured motion and then from a
    simulation of all; then all at once, because the joints act on one another.

    Returns runs and estimate of each joint.
    """
    trajectories = [
        finer_motion(smooth_motion(motion.position, motion.rate), motion.finer)
        for motion in motions
    ]
    starts: list[Drive | None] = [None] * len(robot.joints)
    tolerance = 1e-6 if len(robot.joints) == 1 else _ROUGH
    loads = _loads(motions, robot, trajectories)
    for _ in range(_TURNS):
        estimates = [
            fit_joint(_runs(motions, loads, joint), start, tolerance=tolerance)
            for joint, start in enumerate(starts)
        ]
        starts = [estimate.drive for estimate in estimates]
        drives = np.array(starts)
        trajectories = [
            _simulated(load, drives, motion) for motion, load in zip(motions, loads, strict=True)
        ]
        loads = _loads(motions, robot, trajectories)
    if len(robot.joints) > 1:
        estimates, loads = fit_robot(motions, loads, robot, estimates)
    return [(_runs(motions, loads, joint), estimate) for joint, estimate in enumerate(estimates)]


def _loads(
    motions: Sequence[Motion], robot: RobotModel, trajectories: Sequence[Trajectory]
) -> list[RigidLoad]:
    """What the rigid bodies ask along these trajectories."""
    return [
        RigidLoad.along(motion.robot or robot, trajectory)
        for motion, trajectory in zip(motions, trajectories, strict=True)
    ]


def _simulated(load: RigidLoad, drives: FloatArray, motion: Motion) -> Trajectory:
    """Motion of all joints; that along which the load is where the simulation runs away."""
    simulated = load.simulated(drives, motion)
    if np.isfinite(simulated).all() and np.abs(simulated[0]).max() < LARGEST_ANGLE:
        return simulated
    return load.trajectory


def _runs(motions: Sequence[Motion], loads: Sequence[RigidLoad], joint: int) -> list[Run]:
    """Commands, positions and loads of a joint in all motions."""
    return [
        Run(
            motion.rate,
            np.ascontiguousarray(motion.command[:, joint]),
            np.ascontiguousarray(motion.position[:, joint]),
            motion.valid[:, joint],
            load.of_joint(joint),
            motion.gain,
        )
        for motion, load in zip(motions, loads, strict=True)
    ]


def fit_joint(
    runs: Sequence[Run], start: Drive | None = None, *, tolerance: float = 1e-6
) -> DriveEstimate:
    """Fit one servo; a torque limit and friction by load only where the recording shows them.

    They are there if the evidence of the blocks says so (BIC, with a block for a sample).

    - `start`: of an earlier fit to the same recordings, which decided what is there; None: decide
    """
    scale = scales(runs)
    if start is not None:
        return fit_drive(runs, start, present_parameters(start), scale, tolerance=tolerance)
    least_squares = ordinary_least_squares(runs)
    best = fit_drive(runs, least_squares, _ALWAYS, scale, tolerance=tolerance)
    error = scale[PARAMETERS.index("limit")]
    limits = [{"limit": share * error} for share in _LIMITS]
    for trials in (limits, [{"load_friction": _LOAD_FRICTION}]):
        tried = []
        for trial in trials:
            drive = best.drive._replace(**trial)
            tried.append(
                fit_drive(runs, drive, present_parameters(drive), scale, iterations=_COARSE)
            )
        better = min(tried, key=lambda answer: answer.residual)
        gained = 2.0 * best.blocks * np.log(best.residual / max(better.residual, 1e-300))
        if gained > np.log(best.blocks):
            present = present_parameters(better.drive)
            best = fit_drive(runs, better.drive, present, scale, tolerance=tolerance)
    return best


def present_parameters(drive: Drive) -> list[str]:
    """Names of the parameters that a drive has: a limit or load friction only if it is there."""
    present = list(_ALWAYS)
    if np.isfinite(drive.limit):
        present.append("limit")
    if drive.load_friction > 0.0:
        present.append("load_friction")
    return present
