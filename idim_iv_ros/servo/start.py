"""Where the search for a servo's parameters begins: least squares on filtered motion."""

from collections.abc import Sequence

import numpy as np
import scipy

from idim_iv_ros.servo.fit import PARAMETERS, Run
from idim_iv_ros.servo.loop_kernel import Drive
from idim_iv_ros.types import FloatArray

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
            error = run.gain * (np.interp(place, samples, run.command) - run.position)
            error = smooth_motion(error, run.rate)[0]
            torque = asked_torque(run, q, a)
            rows = np.column_stack([torque, a, v, np.sign(v), np.ones(len(q))])
            moving = run.used & (np.abs(v) > _MOVING * np.abs(v).max(initial=0.0))
            columns.append(rows[moving])
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
    """Torque (n_samples,) that the rigid body asks of one joint at a motion, N m."""
    inertia, torque, slope, along = (values[:: run.finer] for values in run.load)
    return np.asarray(torque + slope * (position - along) + inertia * acceleration)


def scales(runs: Sequence[Run]) -> FloatArray:
    """What is large for each parameter of a drive, (8,), in the order of `PARAMETERS`."""
    error = torque = speed = acceleration = 1e-12
    for run in runs:
        q, v, a = smooth_motion(run.position, run.rate)
        error = max(error, run.gain * float(np.abs(run.command - run.position).max()))
        torque = max(torque, float(np.abs(asked_torque(run, q, a)).max()))
        speed, acceleration = (
            max(speed, float(np.abs(v).max())),
            max(acceleration, float(np.abs(a).max())),
        )
    late = max(2.0 / runs[0].rate, 0.02)
    values = (error / torque, error / acceleration, error / speed, error, error, late, error, 1.0)
    assert len(values) == len(PARAMETERS)
    return np.array(values)
