"""Best rigid model of recordings, by least squares on pinocchio's regressor: what it leaves."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray
from scipy.signal import butter, sosfiltfilt

from benchmarks.withheld_effects.robot import GivenRobot, Inertials
from benchmarks.withheld_effects.world import Record

FloatArray = NDArray[np.float64]
CUTOFF = 20.0  # Hz, of torque and of the friction columns
POSITION_CUTOFF = 40.0  # Hz
KEPT_RATE = 100.0  # Hz
SLOWEST = 0.02  # rad/s, slower samples are left out: the sign of the speed is noise there
TRIM = 0.3  # s at either end, where zero-phase filters have no past or future
DIRECTIONS_KEPT = 1e-11  # of the largest eigenvalue of the normal matrix


@dataclass(frozen=True)
class Filtered:
    """Recordings at KEPT_RATE, one after the other; (n_samples, n_joints) unless said.

    `command_error` is what the recorded effort differs from the configured control law by, N m;
    `direction` is the sign of the speed through the filter of the torque.
    """

    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    torque: FloatArray
    direction: FloatArray
    moving: NDArray[np.bool_]
    command_error: FloatArray


def filtered(given: GivenRobot, records: Sequence[Record]) -> Filtered:
    """Zero-phase filters of torque and motion alike; the time is taken as even."""
    parts = [_filtered(given, record) for record in records]
    return Filtered(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def _filtered(given: GivenRobot, record: Record) -> tuple[FloatArray, ...]:
    period = given.controller.period
    step = round(1.0 / (KEPT_RATE * period))
    edge = round(TRIM / period)
    smooth = butter(4, POSITION_CUTOFF, fs=1.0 / period, output="sos")
    low = butter(4, CUTOFF, fs=1.0 / period, output="sos")
    position = sosfiltfilt(smooth, record.position, axis=0)
    velocity = np.gradient(position, period, axis=0)
    law = given.controller
    wanted = law.kp * (record.position_reference - record.position) + law.kd * (
        law.velocity_reference * record.velocity_reference - record.velocity
    )
    wanted = np.clip(wanted, -law.limit, law.limit)
    # The effort is the mean of two commands, see Record.
    wanted[1:] = 0.5 * (wanted[1:] + wanted[:-1])
    columns = (
        sosfiltfilt(low, position, axis=0),
        sosfiltfilt(low, velocity, axis=0),
        sosfiltfilt(low, np.gradient(velocity, period, axis=0), axis=0),
        sosfiltfilt(low, record.effort, axis=0),
        sosfiltfilt(low, np.sign(velocity), axis=0),
        np.abs(velocity) > SLOWEST,
        sosfiltfilt(low, record.effort - wanted, axis=0),
    )
    return tuple(column[edge:-edge:step] for column in columns)


def residual_variance(given: GivenRobot, motion: Filtered, scale: FloatArray) -> FloatArray:
    """Variance (n_joints,) in (N m)² that the best rigid model leaves of the torque.

    Rigid model: all inertial parameters, drive inertia, viscous and Coulomb friction and offset
    of every joint, fitted to all joints at once by least squares weighted with `scale`
    (n_joints,) N m.
    """
    n = len(given.joints)
    inertial = _inertial_regressor(given, motion)
    samples = len(motion.position)
    columns = np.zeros((samples, n, inertial.shape[2] + 4 * n))
    columns[:, :, : inertial.shape[2]] = inertial
    for j in range(n):
        place = inertial.shape[2] + 4 * j
        columns[:, j, place] = motion.acceleration[:, j]
        columns[:, j, place + 1] = motion.velocity[:, j]
        columns[:, j, place + 2] = motion.direction[:, j]
        columns[:, j, place + 3] = 1.0
    kept = motion.moving
    rows = (columns / scale[None, :, None])[kept]
    torque = (motion.torque / scale)[kept]
    size = np.linalg.norm(rows, axis=0)
    size[size == 0.0] = 1.0
    rows = rows / size
    values, vectors = np.linalg.eigh(rows.T @ rows)
    alive = values > DIRECTIONS_KEPT * values[-1]
    along = vectors[:, alive]
    estimate = along @ ((along.T @ (rows.T @ torque)) / values[alive])
    rest = np.zeros_like(motion.torque)
    rest[kept] = torque - rows @ estimate
    rest *= scale
    count = np.maximum(kept.sum(axis=0), 1)
    return np.asarray((rest**2).sum(axis=0) / count)


def given_variance(given: GivenRobot, inertials: Inertials, motion: Filtered) -> FloatArray:
    """Mean square (n_joints,) in (N m)² of what the nominal model itself leaves."""
    model = _pinocchio_model(given)
    data = model.createData()
    for k in range(len(given.joints)):
        model.inertias[k + 1] = pin.Inertia(
            float(inertials.mass[k]), inertials.centre[k], inertials.inertia[k]
        )
    rigid = np.array(
        [
            pin.rnea(model, data, q, v, a)
            for q, v, a in zip(motion.position, motion.velocity, motion.acceleration, strict=True)
        ]
    )
    rest = motion.torque - rigid - given.armature * motion.acceleration
    rest -= given.viscous * motion.velocity + given.dry * motion.direction
    rest[~motion.moving] = 0.0
    return np.asarray((rest**2).sum(axis=0) / np.maximum(motion.moving.sum(axis=0), 1))


def _inertial_regressor(given: GivenRobot, motion: Filtered) -> FloatArray:
    """(n_samples, n_joints, 10 n_joints), N m per standard parameter."""
    model = _pinocchio_model(given)
    data = model.createData()
    out = np.empty((len(motion.position), model.nv, 10 * model.nv))
    for k in range(len(out)):
        out[k] = pin.computeJointTorqueRegressor(
            model, data, motion.position[k], motion.velocity[k], motion.acceleration[k]
        )
    return out


@lru_cache
def _urdf_model(path: str) -> pin.Model:
    return pin.buildModelFromUrdf(path)


def _pinocchio_model(given: GivenRobot) -> pin.Model:
    return pin.Model(_urdf_model(str(given.urdf)))
