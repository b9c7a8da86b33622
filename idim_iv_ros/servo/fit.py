"""One servo's parameters from commands and positions: the motion of its loop, fitted.

The recording holds no torque. What it holds is a loop, K·sat(command(t − d) − q) = load(q, q̇, q̈) +
Ia·q̈ + D·q̇ + Fc·sign(q̇) + offset, whose simulated motion is compared with the measured one. The
sensitivities of the simulated motion are the instruments of IDIM-IV (paper, section III.B): they
hold none of the noise that stands on both sides of the equation, so that estimates do not tend to
zero as least squares on measured speeds and accelerations do.

The search begins at least squares on filtered motion, which needs no start. Joints act on one
another: after a fit joint by joint all are fitted at once, with the load of the rigid bodies along
their simulated motion.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from idim_iv_ros.model.robot import RobotModel
from idim_iv_ros.servo.loop_kernel import Drive, Load, simulate_joints
from idim_iv_ros.simulation.rigid_body import inverse_dynamics, mass_matrix
from idim_iv_ros.types import BoolArray, FloatArray, IntArray

PARAMETERS = Drive._fields
# Longest step of the simulation, s.
_STEP = 1e-3
_STARTING = 0.3  # s, after which a wrong speed at the first sample has died away
_BLOCK = 1.0  # s, over which residuals may depend on one another
_DIFFERENCE = 1e-4  # of the scale of a parameter
_LARGE = 1e9  # rad, of a simulation that ran away
_UNSEEN = 1e-5  # of the largest eigenvalue: a combination of parameters that changes nothing


@dataclass(frozen=True, kw_only=True)
class Motion:
    """What servos were asked and did in a recording, sampled uniformly."""

    rate: float  # Hz
    command: FloatArray  # (n_samples, n_joints) rad
    position: FloatArray  # (n_samples, n_joints) rad
    valid: BoolArray  # (n_samples, n_joints): whether the position was measured
    gain: float = 1.0  # Of the loops, in parts of that for which K is asked
    name: str = ""

    @property
    def used(self) -> BoolArray:
        """Which samples (n_samples, n_joints) count in the fit: measured, and after the start."""
        used = self.valid.copy()
        used[: int(np.ceil(_STARTING * self.rate))] = False
        return used


@dataclass(frozen=True, kw_only=True)
class Run(Motion):
    """Motion of one joint, or of all, with what the rigid bodies ask along it."""

    load: Load  # Of n_samples · finer instants
    # (n_samples · finer, n_joints) rad/s²: of the motion along which the load of all joints holds
    acceleration: FloatArray | None = None

    @property
    def finer(self) -> int:
        """How many samples of the load there are to a sample of the recording."""
        return len(self.load.torque) // len(self.command)

    def of_joint(self, joint: int) -> "Run":
        """Return the run of one joint of a run of all joints, the others moving as they do."""
        assert self.acceleration is not None
        accelerations, column = self.acceleration.copy(), slice(joint, joint + 1)
        accelerations[:, joint] = 0.0
        coupled = np.einsum("sk,sk->s", self.load.mass[:, joint], accelerations)
        mass, torque, slope, position = (part[:, column] for part in self.load)
        return replace(
            self,
            command=self.command[:, column],
            position=self.position[:, column],
            valid=self.valid[:, column],
            load=Load(mass[:, :, column], torque + coupled[:, None], slope, position),
            acceleration=None,
        )

    def followed(self, drives: FloatArray) -> FloatArray:
        """Position and speed (2, n_samples · finer, n_joints) behind servos that start at rest.

        - `drives`: (n_joints, 8), as `Drive`
        """
        rate = self.rate * self.finer
        command = np.repeat(self.command, self.finer, axis=0)
        motion = np.empty((2, *command.shape))
        state = np.zeros((6, command.shape[1]))
        state[0] = self.position[0]
        simulate_joints(
            drives,
            Load(*map(np.ascontiguousarray, self.load)),
            command,
            rate,
            self.gain,
            int(np.ceil(1.0 / (rate * _STEP) - 1e-6)),
            state,
            motion,
        )
        return motion

    def simulated(self, drives: FloatArray | Drive) -> FloatArray:
        """Positions (n_samples, n_joints) rad of the joints that follow their commands."""
        return np.asarray(self.followed(np.atleast_2d(drives))[0, :: self.finer])


@dataclass(frozen=True)
class DriveEstimate:
    """Parameters of one servo, divided by its stiffness, with their covariance."""

    drive: Drive
    covariance: FloatArray  # (8, 8): In the order of `PARAMETERS`; zero where a parameter was given
    residual: float  # Root mean square of measured less simulated position, rad
    blocks: int  # That the covariance rests on

    @property
    def free(self) -> list[str]:
        """Names of the parameters of the drive that were fitted."""
        fitted = np.diag(self.covariance) > 0.0
        return [name for name, free in zip(PARAMETERS, fitted, strict=True) if free]


def residuals(runs: Sequence[Run], drives: FloatArray | Drive) -> FloatArray:
    """Measured less simulated positions of all runs where they are compared, (n,) rad."""
    joined = np.concatenate([(run.position - run.simulated(drives))[run.used] for run in runs])
    return np.asarray(np.nan_to_num(joined, nan=_LARGE, posinf=_LARGE, neginf=-_LARGE))


def fit_drive(
    runs: Sequence[Run],
    start: Drive,
    free: Sequence[str],
    *,
    iterations: int = 60,
    tolerance: float = 1e-6,
) -> DriveEstimate:
    """Fit the free parameters to all runs at once.

    - `start`: where the search begins, and the value of what is not free
    - `free`: of `PARAMETERS`
    - `tolerance`: share by which the cost must fall for another iteration
    """
    places = [PARAMETERS.index(name) for name in free]
    first, unit = np.array(start, dtype=float), scales(runs)[places]
    low = np.array([-np.inf if name == "offset" else 0.0 for name in free])

    def drive(x: FloatArray) -> Drive:
        values = first.copy()
        values[places] = x * unit
        return Drive(*values)

    def difference(x: FloatArray) -> FloatArray:
        return residuals(runs, drive(x))

    def slopes(x: FloatArray) -> FloatArray:
        columns = []
        for k, step in enumerate(_DIFFERENCE * np.eye(len(x))):
            lower = np.maximum(x - step, low)
            columns.append((difference(x + step) - difference(lower)) / (x[k] + step[k] - lower[k]))
        return np.column_stack(columns)

    answer = scipy.optimize.least_squares(
        difference,
        np.maximum(first[places] / unit, low + 1e-6),
        slopes,
        bounds=(low, np.inf),
        x_scale="jac",
        max_nfev=iterations,
        xtol=1e-6,
        ftol=tolerance,
    )
    covariance = np.zeros((len(first), len(first)))
    sandwich, blocks = block_covariance(used_labels(runs), answer.fun, answer.jac)
    covariance[np.ix_(places, places)] = sandwich * np.outer(unit, unit)
    residual = float(np.sqrt(np.mean(answer.fun**2)))
    return DriveEstimate(drive(answer.x), covariance, residual, blocks)


def used_labels(runs: Sequence[Motion]) -> IntArray:
    """Numbers (n,) of the blocks of time of all samples that count in the fit."""
    labels, count = [], 0
    for run in runs:
        label = count + np.arange(len(run.command)) // max(int(_BLOCK * run.rate), 1)
        labels.append(np.broadcast_to(label[:, None], run.command.shape)[run.used])
        count = int(label[-1]) + 1
    return np.concatenate(labels)


def block_covariance(
    labels: IntArray, residual: FloatArray, slopes: FloatArray
) -> tuple[FloatArray, int]:
    """Covariance (p, p) that holds for residuals which depend on one another within a block.

    What the estimate changes by without each block (the jackknife over clusters). Combinations of
    parameters that change nothing get a variance without bound.

    Returns the covariance and the number of blocks.
    """
    names, place = np.unique(labels, return_inverse=True)
    count = len(names)
    size = np.maximum(np.linalg.norm(slopes, axis=0), 1e-30)
    slopes = slopes / size
    order = np.argsort(place, kind="stable")
    cuts = np.searchsorted(place[order], np.arange(1, count))
    whole = slopes.T @ slopes
    covariance = np.zeros(whole.shape)
    for rows in np.split(order, cuts):
        without = whole - slopes[rows].T @ slopes[rows]
        change = np.linalg.pinv(without, hermitian=True) @ (slopes[rows].T @ residual[rows])
        covariance += np.outer(change, change)
    covariance *= (count - 1) / count
    values, directions = np.linalg.eigh(whole)
    for direction in directions.T[values <= _UNSEEN * values[-1]]:  # all, where nothing changes
        covariance += _LARGE * np.outer(direction, direction)
    return covariance / np.outer(size, size), count


def fit_factor(scaled: Callable[[float], Run], answer: DriveEstimate) -> tuple[float, float]:
    """Factor with which a drive fitted to other runs suits a run best.

    - `scaled`: the run whose gain or load is multiplied by a factor

    Returns the factor and its standard deviation, which allows for the uncertainty of the drive.
    """

    def residual(factor: float, drive: FloatArray | Drive = answer.drive) -> FloatArray:
        return residuals([scaled(factor)], drive)

    def slope(function: Callable[[float], FloatArray], at: float, step: float) -> FloatArray:
        return (function(at + step) - function(at - step)) / (2.0 * step)

    solution = scipy.optimize.least_squares(
        lambda x: residual(float(x[0])), [1.0], bounds=(0.01, 100.0), x_scale="jac"
    )
    factor = float(solution.x[0])
    by_factor = slope(residual, factor, _DIFFERENCE)
    scatter, _ = block_covariance(used_labels([scaled(1.0)]), solution.fun, by_factor[:, None])
    values, spread = np.array(answer.drive), np.sqrt(np.diag(answer.covariance))
    change = np.zeros(len(values))
    for k in np.flatnonzero(spread > 0.0):

        def moved(value: float, k: int = int(k)) -> FloatArray:
            drive = values.copy()
            drive[k] = value
            return residual(factor, drive)

        step = min(0.1 * float(spread[k]), 0.5 * values[k] + 1e-6)
        change[k] = -float(by_factor @ slope(moved, float(values[k]), step))
    change /= float(by_factor @ by_factor)
    return factor, float(np.sqrt(scatter[0, 0] + change @ answer.covariance @ change))


_CUTOFF, _ORDER = 8.0, 4  # Hz
_MOST_OF_NYQUIST = 0.4
_LONGEST_DELAY = 0.25  # s
_MOVING = 0.05  # of the greatest speed, from which the sign of the friction is known


def smooth_motion(position: FloatArray, rate: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Position, speed and acceleration (n_samples, …) of a measured motion, without phase shift."""
    cutoff = min(_CUTOFF, _MOST_OF_NYQUIST * 0.5 * rate)
    sections = scipy.signal.butter(_ORDER, cutoff, fs=rate, output="sos")
    smooth = scipy.signal.sosfiltfilt(sections, position, axis=0)
    speed = np.gradient(smooth, 1.0 / rate, axis=0)
    return smooth, speed, np.gradient(speed, 1.0 / rate, axis=0)


def ordinary_least_squares(runs: Sequence[Run], *, delay: float | None = None) -> Drive:
    """Regress the command error on measured motion, without instruments.

    Measured speeds and accelerations stand on the right and hold noise: the estimates are biased
    (see `fit`), and serve as a start.

    - `delay`: s; None: that of a grid of half samples which leaves the smallest residual
    """
    most = _LONGEST_DELAY if delay is None else 0.0
    halves = np.arange(0.0, most + 1e-9, 0.5 / runs[0].rate) if delay is None else [delay]
    best, smallest = Drive(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, np.inf, 0.0), np.inf
    motions = [smooth_motion(run.position, run.rate) for run in runs]
    for late in halves:
        columns, errors = [], []
        for run, (q, v, a) in zip(runs, motions, strict=True):
            samples = np.arange(len(q))
            place = samples - late * run.rate - 0.5
            late_command = np.interp(place, samples, run.command[:, 0])[:, None]
            error, _, _ = smooth_motion(run.gain * (late_command - run.position), run.rate)
            rows = np.column_stack([asked_torque(run, q, a), a, v, np.sign(v), np.ones(len(q))])
            moving = run.used & (np.abs(v) > _MOVING * np.abs(v).max(initial=0.0))
            columns.append(rows[moving[:, 0]])
            errors.append(error[moving])
        matrix, target = np.concatenate(columns), np.concatenate(errors)
        size = np.maximum(np.linalg.norm(matrix, axis=0), 1e-12)
        low = [0.0, 0.0, 0.0, 0.0, -np.inf]
        answer = scipy.optimize.lsq_linear(matrix / size, target, bounds=(low, np.inf))
        if answer.cost < smallest:
            smallest = float(answer.cost)
            compliance, inertia, damping, friction, offset = (answer.x / size).tolist()
            best = Drive(compliance, inertia, damping, friction, offset, float(late), np.inf, 0.0)
    return best


def asked_torque(run: Run, position: FloatArray, acceleration: FloatArray) -> FloatArray:
    """Torque (n_samples, 1) that the rigid body asks of one joint at a motion, N m."""
    mass, torque, slope, along = (values[:: run.finer] for values in run.load)
    return np.asarray(torque + slope * (position - along) + mass[:, 0] * acceleration)


def scales(runs: Sequence[Run]) -> FloatArray:
    """Sizes (8,) that the parameters of a drive may have, in the order of `PARAMETERS`."""
    error = torque = speed = acceleration = 1e-12
    for run in runs:
        q, v, a = smooth_motion(run.position, run.rate)
        error = max(error, run.gain * float(np.abs(run.command - run.position).max()))
        torque = max(torque, float(np.abs(asked_torque(run, q, a)).max()))
        speed = max(speed, float(np.abs(v).max()))
        acceleration = max(acceleration, float(np.abs(a).max()))
    late = max(2.0 / runs[0].rate, 0.02)
    drive = Drive(
        error / torque, error / acceleration, error / speed, error, error, late, error, 1.0
    )
    return np.array(drive)


_FINE = 200.0  # Hz, least rate of what the rigid bodies ask
_BEND = 1e-4  # rad, of the slope of a torque with its joint's position
_ITERATIONS, _HALVINGS = 6, 3
_ENOUGH = 1e-3  # share by which the cost must fall for another iteration
_SHARE_OF_STD = 0.2  # standard deviations
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
    for joint, step in enumerate(_BEND * np.eye(position.shape[1])):
        there = inverse_dynamics(robot, bodies, position + step, velocity, rest)
        slope[:, joint] = (there - bias)[:, joint] / _BEND
    load = Load(mass_matrix(robot, bodies, position), bias, slope, position)
    return Run(**vars(motion), load=load, acceleration=acceleration)


def followed_motion(run: Run, drives: FloatArray) -> Trajectory:
    """Motion (3, n_samples · finer, n_joints) of all joints behind servos (n_joints, 8)."""
    position, speed = run.followed(drives)
    # Of the speeds: what acts between two samples is the mean acceleration there.
    return np.stack([position, speed, np.gradient(speed, 1.0 / (run.rate * run.finer), axis=0)])


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
    free = tuple(places.T)
    low = np.array([-np.inf if PARAMETERS[k] == "offset" else 0.0 for _, k in places])
    current = list(runs)
    residual = residuals(current, drives)
    owner = np.concatenate([np.argwhere(motion.used)[:, 1] for motion in motions])
    weights = _weights(owner, residual)
    columns = []
    for joint, k in places:
        step = _SHARE_OF_STD * spread[joint, k]
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
            trial[free] = np.maximum(drives[free] + change * 0.5**halving, low)
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
        taken = trial[free] - drives[free]
        scaled, missed = taken / spread[free], (residual - left) - slopes @ taken
        slopes = slopes + np.outer(missed, scaled / spread[free]) / (scaled @ scaled)
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
        trajectory = np.stack(smooth_motion(motion.position, motion.rate))
        if finer > 1:
            samples = trajectory.shape[1]
            place = np.minimum(np.arange(samples * finer) / finer, samples - 1.0)
            there = scipy.interpolate.make_interp_spline(np.arange(samples), trajectory, axis=1)
            trajectory = there(place)
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
