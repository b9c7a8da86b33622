"""A motion that a robot is asked for, and its CSV file."""

import csv
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TextIO

import numpy as np
import scipy

from idim_iv_ros.errors import DataError, UsageError
from idim_iv_ros.files import FilePath, is_file
from idim_iv_ros.recording.table_file import TextTable, one_line_errors
from idim_iv_ros.types import FloatArray

SIGNALS = ("position", "velocity", "acceleration")
QUINTIC_SPEED, QUINTIC_ACCELERATION = 1.875, 10.0 / np.sqrt(3.0)  # largest of `quintic`
# Stamps may be rounded to this share of a period.
_JITTER = 0.05
_SHORTEST_STEP = 1e-9  # s, a thousandth of what is accepted

# More than an hour of 1000 per second; each signal of each joint is an array of so many.
MOST_SAMPLES = 4_000_000
_SLOWEST, _FASTEST = 1.0, 1e5  # samples per second


@dataclass(frozen=True)
class Trajectory:
    """Positions, velocities and accelerations on a uniform grid that starts at 0 s.

    (n_samples, n_joints) each, rad, rad/s, rad/s² (m, m/s, m/s² for prismatic joints).
    """

    joints: tuple[str, ...]
    rate: float  # Samples per second
    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray

    @property
    def time(self) -> FloatArray:
        """Stamps (n_samples,) s."""
        return np.asarray(np.arange(len(self.position)) / self.rate)

    @property
    def duration(self) -> float:
        """Seconds from the first to the last sample."""
        return (len(self.position) - 1) / self.rate

    def in_order(self, joints: Sequence[str]) -> "Trajectory":
        """Return the same motion with its columns in the order of a robot's joints.

        Raises UsageError: the robot has other joints.
        """
        if set(self.joints) != set(joints):
            raise UsageError(
                f"the trajectory is for {', '.join(self.joints)}; the robot has {', '.join(joints)}"
            )
        columns = [self.joints.index(joint) for joint in joints]
        return Trajectory(tuple(joints), self.rate, *(part[:, columns] for part in self.signals))

    def points(self, rate: float) -> Iterator[tuple[int, list[list[float]]]]:
        """Thin the motion to about `rate` points per second; the last sample is one of them.

        Yields the time of each point from the start, ns, with its position, velocity and
        acceleration.
        """
        step, last = max(1, round(self.rate / rate)), len(self.position) - 1
        for sample in [*range(0, last, step), last]:
            yield round(sample / self.rate * 1e9), [part[sample].tolist() for part in self.signals]

    @property
    def signals(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Position, velocity and acceleration, (n_samples, n_joints)."""
        return self.position, self.velocity, self.acceleration


def quintic(s: FloatArray) -> FloatArray:
    """10 s³ - 15 s⁴ + 6 s⁵, from rest at s = 0 to rest at 1, and two derivatives by s, (3, …)."""
    return np.stack(
        [
            s**3 * (10.0 - 15.0 * s + 6.0 * s**2),
            30.0 * s**2 * (1.0 - s) ** 2,
            60.0 * s * (1.0 - s) * (1.0 - 2.0 * s),
        ]
    )


def shortest_quintic(way: FloatArray, speed: FloatArray, acceleration: FloatArray) -> float:
    """Seconds in which all joints go a way from rest to rest (`quintic`) within these limits.

    Way, speed and acceleration: (n_joints,) rad, rad/s, rad/s² (m, m/s, m/s²).
    """
    by_speed = np.max(QUINTIC_SPEED * np.abs(way) / speed)
    by_acceleration = np.max(np.sqrt(QUINTIC_ACCELERATION * np.abs(way) / acceleration))
    return float(max(by_speed, by_acceleration))


def require_sampling(rate: float, duration: float, what: str) -> None:
    """Refuse a rate, samples per second, that no controller has, and too many samples in all.

    Raises UsageError: they are out of their range; `what` has them, for the message.
    """
    if not _SLOWEST <= rate <= _FASTEST:
        raise UsageError(
            f"{what} has {rate:.4g} samples per second: {_SLOWEST:g} to {_FASTEST:g} are possible"
        )
    if not 0.0 < duration < math.inf:
        raise UsageError(f"{what} lasts {duration:g} s: a positive number of seconds is needed")
    if rate * duration > MOST_SAMPLES:
        raise UsageError(
            f"{what} lasts {duration:.4g} s: at {rate:.4g} samples per second at most "
            f"{MOST_SAMPLES / rate:.4g} s are possible"
        )


def read_trajectory(path: FilePath) -> Trajectory:
    """Read a trajectory from CSV: ``time,<joint>.position,…[,<joint>.velocity,…]``.

    Columns may be in any order; others are ignored. Velocities and accelerations that are
    missing are central differences of what is there, second order at the ends too.

    Raises UsageError: unreadable file, missing columns, a cell that is not a finite number, fewer
    than three samples, or stamps that are not uniform. The message is one line and names the file.
    """
    path = Path(path)
    if not is_file(path):
        raise UsageError(f"{path}: cannot read the trajectory: no such file")
    try:
        with one_line_errors(path):
            table = TextTable(path)
            used = [n for n in table.names if n == "time" or n.rpartition(".")[2] in SIGNALS]
            values = table.columns([table.number(name) for name in used])
    except DataError as error:
        raise UsageError(str(error)) from error
    columns = dict(zip(used, values, strict=True))
    for name, column in columns.items():
        if not np.isfinite(column).all():
            sample = 1 + int(np.argmin(np.isfinite(column)))
            raise UsageError(f"{path}: {name} of sample {sample} is not a finite number")
    joints = tuple(name[: -len(".position")] for name in columns if name.endswith(".position"))
    if "time" not in columns or not joints:
        raise UsageError(f"{path}: the columns time and <joint>.position are needed")
    samples = len(columns["time"])
    if samples < 3:
        raise UsageError(f"{path}: {samples} samples; at least 3 are needed")
    rate = _rate(path, columns["time"])
    motion = [np.column_stack([columns[f"{joint}.position"] for joint in joints])]
    for signal in SIGNALS[1:]:
        names = [f"{joint}.{signal}" for joint in joints]
        present = [name for name in names if name in columns]
        if not present:
            motion.append(np.gradient(motion[-1], 1.0 / rate, axis=0, edge_order=2))
        elif len(present) == len(names):
            motion.append(np.column_stack([columns[name] for name in names]))
        else:
            missing = next(name for name in names if name not in columns)
            raise UsageError(
                f"{path}: {present[0]} is there, {missing} is missing; give all or none"
            )
    return Trajectory(joints, rate, *motion)


def write_csv(trajectory: Trajectory, file: TextIO) -> None:
    """Write every sample; what `read_trajectory` reads, to ten digits."""
    names = [f"{joint}.{signal}" for signal in SIGNALS for joint in trajectory.joints]
    csv.writer(file, lineterminator="\n").writerow(["time", *names])
    table = np.column_stack([trajectory.time, *trajectory.signals])
    np.savetxt(file, table, fmt="%.10g", delimiter=",")


def _rate(path: Path, time: FloatArray) -> float:
    steps = np.diff(time)
    step = float((time[-1] - time[0]) / len(steps))
    if not step > 0.0 or np.any(steps <= 0.0):
        raise UsageError(f"{path}: the stamps do not increase")
    if np.max(np.abs(steps - step)) > _JITTER * step:
        raise UsageError(
            f"{path}: the stamps are not uniform: steps of {steps.min():.4g} to "
            f"{steps.max():.4g} s; resample the trajectory"
        )
    # Decimal stamps: 1 / mean step is 999.9999999998 for 1000 per second.
    rate = float(np.round(1.0 / max(step, _SHORTEST_STEP), 6))
    require_sampling(rate, step * len(steps), f"{path}: the trajectory")
    return rate


_BLOCK = 2000  # samples


@dataclass(frozen=True)
class FourierBasis:
    """Shapes of a motion: q(t) = start + Σ shape_i(t) c_i, with q(0) = start.

    Every shape is a sum of sin(kωt)/k and cos(kωt)/k, k = 1 … harmonics, ω = 2π / period, whose
    velocity and acceleration are zero at t = 0 (and so at every multiple of the period): two
    linear constraints on the 2 · harmonics coefficients, solved once by their null space.

    Source: Swevers, Ganseman, Tükel, De Schutter, Van Brussel, Optimal robot excitation and
    identification, IEEE Trans. Robotics and Automation 13 (1997), equation 10.
    """

    period: float
    harmonics: int

    def __post_init__(self) -> None:
        if not (np.isfinite(self.period) and self.period > 0.0):
            raise UsageError(f"period {self.period:g}: seconds above 0 are needed")
        if self.harmonics < 2:
            raise UsageError("harmonics: at least 2 are needed for a motion that starts at rest")

    @property
    def size(self) -> int:
        """Number of basis functions from which the motion of a joint is made."""
        return 2 * self.harmonics - 2

    def shapes(self, time: FloatArray) -> FloatArray:
        """Position, velocity and acceleration of the shapes, (3, n_samples, size)."""
        return self.motion(time, np.eye(self.size))

    def motion(self, time: FloatArray, coefficients: FloatArray) -> FloatArray:
        """Σ shape_i(t) c_i, (3, n_samples, n_joints), for `coefficients` (size, n_joints).

        Long motions have many harmonics: the shapes of all samples are never in memory at once.
        """
        sines, cosines = _at_rest(self.harmonics)
        odd_part = sines @ coefficients[: self.harmonics - 1]
        even_part = cosines @ coefficients[self.harmonics - 1 :]
        blocks = [
            [odd @ odd_part + even @ even_part for odd, even in self._waves(time[k : k + _BLOCK])]
            for k in range(0, len(time), _BLOCK)
        ]
        return np.concatenate(blocks, axis=1)

    def _waves(self, time: FloatArray) -> tuple[tuple[FloatArray, FloatArray], ...]:
        """Sine and cosine of each harmonic over its order, and two time derivatives."""
        order = np.arange(1, self.harmonics + 1)
        pulsation = 2.0 * np.pi / self.period * order
        sine, cosine = np.sin(time[:, None] * pulsation), np.cos(time[:, None] * pulsation)
        speed, rate = pulsation / order, pulsation**2 / order
        return (
            (sine / order, (cosine - 1.0) / order),
            (cosine * speed, -sine * speed),
            (-sine * rate, -cosine * rate),
        )


@cache
def _at_rest(harmonics: int) -> tuple[FloatArray, FloatArray]:
    """Coefficients of the sines without velocity, of the cosines without acceleration, at t = 0."""
    order = np.arange(1.0, harmonics + 1.0)
    return scipy.linalg.null_space(np.ones((1, harmonics))), scipy.linalg.null_space(order[None, :])
