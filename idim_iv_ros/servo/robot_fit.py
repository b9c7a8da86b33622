"""All servos of a robot at once: what its rigid bodies ask along a motion, and their fit."""

from collections.abc import Sequence

import numpy as np
import scipy

from idim_iv_ros.model.robot import RobotModel
from idim_iv_ros.servo.fit import (
    PARAMETERS,
    DriveEstimate,
    Motion,
    Run,
    block_covariance,
    fit_drive,
    ordinary_least_squares,
    residuals,
    scales,
    smooth_motion,
    used_labels,
)
from idim_iv_ros.servo.loop_kernel import Drive, Load
from idim_iv_ros.simulation.rigid_body import inverse_dynamics, mass_matrix
from idim_iv_ros.types import FloatArray, IntArray

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


def loaded(motion: Motion, robot: RobotModel, trajectory: Trajectory) -> Run:
    """Return a motion with what the nominal rigid bodies ask along a trajectory, without drives."""
    position, velocity, acceleration = trajectory
    bodies, rest = robot.given.of_links, np.zeros_like(position)
    bias = inverse_dynamics(robot, bodies, position, velocity, rest)
    slope = np.empty_like(bias)
    for joint, step in enumerate(_STEP * np.eye(position.shape[1])):
        there = inverse_dynamics(robot, bodies, position + step, velocity, rest)
        slope[:, joint] = (there - bias)[:, joint] / _STEP
    load = Load(mass_matrix(robot, bodies, position), bias, slope, position)
    return Run(**vars(motion), load=load, acceleration=acceleration)


def followed_motion(run: Run, drives: FloatArray) -> Trajectory:
    """Motion (3, n_samples · finer, n_joints) of all joints behind servos (n_joints, 8)."""
    position, speed = run.followed(drives)
    # Of the speeds: what acts between two samples is the mean acceleration there.
    return np.stack([position, speed, np.gradient(speed, 1.0 / (run.rate * run.finer), axis=0)])


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
    runs: Sequence[Run],
    robot: RobotModel,
    estimates: Sequence[DriveEstimate],
) -> tuple[list[DriveEstimate], list[Run]]:
    """Improve estimates that were made joint by joint.

    Sensitivities are taken once; the rigid bodies' torques are taken again along the motion of
    every iteration. Joints are weighted by their residuals.

    Returns estimates, and runs with the load along the last simulated motion.
    """
    drives = np.array([estimate.drive for estimate in estimates])
    spread = np.sqrt([np.diag(estimate.covariance) for estimate in estimates])
    places = np.argwhere(spread > 0.0)
    low = np.array([-np.inf if PARAMETERS[k] == "offset" else 0.0 for _, k in places])
    current = list(runs)
    residual = residuals(current, drives)
    owner = np.concatenate([np.argwhere(motion.used)[:, 1] for motion in motions])
    weights = _weights(owner, residual)
    columns = []
    for joint, k in places:
        step = _DIFFERENCE * spread[joint, k]
        moved = drives.copy()
        moved[joint, k] += step
        columns.append((residual - residuals(current, moved)) / step)
    slopes = np.column_stack(columns)
    cost = float(residual @ (weights * residual))
    for _ in range(_ITERATIONS):
        weighted = slopes * weights[:, None]
        change = np.linalg.lstsq(weighted.T @ slopes, weighted.T @ residual, rcond=1e-12)[0]
        for halving in range(_HALVINGS):
            trial = drives.copy()
            values = drives[tuple(places.T)] + change * 0.5**halving
            trial[tuple(places.T)] = np.maximum(values, low)
            simulated = [followed_motion(run, trial) for run in current]
            if not np.isfinite(np.concatenate(simulated, axis=1)).all():
                continue
            pairs = zip(motions, simulated, strict=True)
            along = [loaded(motion, robot, there) for motion, there in pairs]
            left = residuals(along, trial)
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
    root = np.sqrt(_weights(owner, residual))
    labels = used_labels(motions)
    covariance, blocks = block_covariance(labels, root * residual, root[:, None] * slopes)
    improved = []
    for joint in range(len(drives)):
        mine = places[:, 0] == joint
        whole = np.zeros((len(PARAMETERS), len(PARAMETERS)))
        whole[np.ix_(places[mine, 1], places[mine, 1])] = covariance[np.ix_(mine, mine)]
        rms = float(np.sqrt(np.mean(residual[owner == joint] ** 2)))
        improved.append(DriveEstimate(Drive(*drives[joint]), whole, rms, blocks))
    return improved, current


def _weights(owner: IntArray, residual: FloatArray) -> FloatArray:
    """Weights (n,) of residuals: one over the mean square of all those of their joint (n,)."""
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
    runs = []
    for motion in motions:
        finer = max(int(np.ceil(_FINE / motion.rate - 1e-6)), 1)
        trajectory = finer_motion(smooth_motion(motion.position, motion.rate), finer)
        runs.append(loaded(motion, robot, trajectory))
    starts: list[Drive | None] = [None] * len(robot.joints)
    tolerance = 1e-6 if len(robot.joints) == 1 else _ROUGH
    for _ in range(_TURNS):
        estimates = [
            fit_joint([run.of_joint(joint) for run in runs], start, tolerance=tolerance)
            for joint, start in enumerate(starts)
        ]
        starts = [estimate.drive for estimate in estimates]
        simulated = [followed_motion(run, np.array(starts)) for run in runs]
        # Where a simulation runs away the load stays that of the motion before.
        for k, there in enumerate(simulated):
            if np.isfinite(there).all() and np.abs(there[0]).max() < LARGEST_ANGLE:
                runs[k] = loaded(motions[k], robot, there)
    if len(robot.joints) > 1:
        estimates, runs = fit_robot(motions, runs, robot, estimates)
    return [
        ([run.of_joint(joint) for run in runs], estimate)
        for joint, estimate in enumerate(estimates)
    ]


def fit_joint(
    runs: Sequence[Run], start: Drive | None = None, *, tolerance: float = 1e-6
) -> DriveEstimate:
    """Fit one servo; a torque limit and friction by load only where the recording shows them.

    They are there if the evidence of the blocks says so (BIC, with a block for a sample).

    - `start`: of an earlier fit to the same recordings, which decided what is there; None: decide
    """
    if start is not None:
        return fit_drive(runs, start, present_parameters(start), tolerance=tolerance)
    best = fit_drive(runs, ordinary_least_squares(runs), _ALWAYS, tolerance=tolerance)
    error = scales(runs)[PARAMETERS.index("limit")]
    limits = [{"limit": share * error} for share in _LIMITS]
    for trials in (limits, [{"load_friction": _LOAD_FRICTION}]):
        drives = [best.drive._replace(**trial) for trial in trials]
        tried = [
            fit_drive(runs, drive, present_parameters(drive), iterations=_COARSE)
            for drive in drives
        ]
        better = min(tried, key=lambda answer: answer.residual)
        gained = 2.0 * best.blocks * np.log(best.residual / max(better.residual, 1e-300))
        if gained > np.log(best.blocks):
            present = present_parameters(better.drive)
            best = fit_drive(runs, better.drive, present, tolerance=tolerance)
    return best


def present_parameters(drive: Drive) -> list[str]:
    """Names of the parameters that a drive has: a limit or load friction only if it is there."""
    present = list(_ALWAYS)
    if np.isfinite(drive.limit):
        present.append("limit")
    if drive.load_friction > 0.0:
        present.append("load_friction")
    return present
