"""One servo's parameters from commands and positions: the motion of its loop, fitted.

The recording holds no torque. What it holds is a loop, K·sat(command(t − d) − q) = load(q, q̇, q̈) +
Ia·q̈ + D·q̇ + Fc·sign(q̇) + offset, whose simulated motion is compared with the measured one. The
sensitivities of the simulated motion are the instruments of IDIM-IV (paper, section III.B): they
hold none of the noise that stands on both sides of the equation, so that estimates do not tend to
zero as least squares on measured speeds and accelerations do.

The search begins at least squares on filtered motion, which needs no start.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from idim_iv_ros.servo.loop_kernel import Drive, Load, simulate_joints
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
        """Return the run of one joint, the others moving as they do."""
        assert self.acceleration is not None
        accelerations, column = self.acceleration.copy(), slice(joint, joint + 1)
        accelerations[:, joint] = 0.0
        coupled = np.einsum("sk,sk->s", self.load.mass[:, joint], accelerations)
        return replace(
            self,
            command=self.command[:, column],
            position=self.position[:, column],
            valid=self.valid[:, column],
            load=Load(
                self.load.mass[:, column, column],
                self.load.torque[:, column] + coupled[:, None],
                self.load.slope[:, column],
                self.load.position[:, column],
            ),
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
    parts = [(run.position - run.simulated(drives))[run.used] for run in runs]
    joined = np.concatenate(parts)
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
            torque = asked_torque(run, q, a)
            rows = np.column_stack([torque, a, v, np.sign(v), np.ones(len(q))])
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
