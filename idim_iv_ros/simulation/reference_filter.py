"""Instruments without a control law: the reference through a fitted closed-loop filter."""

import numpy as np
import scipy
from numpy.typing import NDArray

from idim_iv_ros.types import FloatArray

ORDER = 4
# Poles of the filter that are tried, Hz, where the rate allows them.
POLES = np.geomspace(0.3, 30.0, 7)
# The first part of the record fits each candidate, the rest chooses among them.
FITTED_SHARE = 0.7
FITTED_ROWS = 4000


def filter_reference(
    rate: float, position: FloatArray, position_reference: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Fit, joint by joint, the filter from the references to the position.

    The tracking error is expanded in discrete Laguerre filters of the joint's own reference, of
    those of all joints, or of these and their sines and cosines (gravity) and the sign of the
    joint's reference velocity (friction): whichever predicts the last part of the record best.
    References are free of noise, so that least squares has no bias from that of the position,
    however autocorrelated (Ljung, System Identification, section 4.4 on orthonormal bases).

    - `rate`: Hz
    - `position`, `position_reference`: (n_samples, n_joints) rad or m

    Returns the positions (n_samples, n_joints) that the closed loop would take without noise, and
    of each joint, on the last 30 % of the record, which the filter had not seen, the RMS of
    measured less filtered position and the standard deviation of the measured one, rad or m.
    """
    error = position_reference - position
    samples, joints = error.shape
    every = max(1, samples // FITTED_ROWS)
    some = error[::every]
    split = int(FITTED_SHARE * len(some))
    signals = _signals(position_reference)
    energy = np.full(joints, np.inf)
    chosen = [(0, 1.0)] * joints
    for pole in np.exp(-2.0 * np.pi * POLES[rate / 4.0 > POLES] / rate).tolist():
        columns = _columns(signals, pole, every)
        gram = columns[:split].T @ columns[:split]
        moments = columns[:split].T @ some[:split]
        for joint in range(joints):
            for number, kept in enumerate(_candidates(joint, joints)):
                solution = _solve(gram[np.ix_(kept, kept)], moments[kept, joint])
                residual = some[split:, joint] - columns[split:, kept] @ solution
                if residual @ residual < energy[joint]:
                    energy[joint], chosen[joint] = residual @ residual, (number, pole)
    explained = np.zeros_like(error)
    for joint, (number, pole) in enumerate(chosen):
        kept = _candidates(joint, joints)[number]
        columns = _columns(signals, pole, every)[:, kept]
        weights = np.zeros(1 + ORDER * len(signals))
        weights[kept] = _solve(columns.T @ columns, columns.T @ some[:, joint])
        explained[:, joint] = weights[0]
        for signal, of_signal in zip(signals, weights[1:].reshape(-1, ORDER), strict=True):
            if np.any(of_signal != 0.0):
                explained[:, joint] += _laguerre(signal, pole) @ of_signal
    missed = np.sqrt(energy / max(len(some) - split, 1))
    return position_reference - explained, missed, np.std(position[::every][split:], axis=0)


def _signals(reference: FloatArray) -> FloatArray:
    """Inputs (5 n_joints, n_samples): positions, velocities, sines, cosines, directions."""
    speed = np.gradient(reference, axis=0)
    kinds = [reference, speed, np.sin(reference), np.cos(reference), np.sign(speed)]
    return np.ascontiguousarray(np.hstack(kinds).T)


def _candidates(joint: int, joints: int) -> list[NDArray[np.int64]]:
    """Columns of `_columns` that each set of inputs of a joint has: its own reference, those of all
    joints, and these with their sines and cosines and its direction.
    """
    position, velocity, sine, cosine, direction = np.arange(5 * joints).reshape(5, joints)
    motion, waves = [position, velocity[[joint]]], [sine, cosine, direction[[joint]]]
    sets = [[position[[joint]], velocity[[joint]]], motion, [*motion, *waves]]
    firsts = [1 + ORDER * np.concatenate(inputs) for inputs in sets]
    return [np.append(0, (first[:, None] + np.arange(ORDER)).ravel()) for first in firsts]


def _columns(signals: FloatArray, pole: float, every: int) -> FloatArray:
    """Ones, then the Laguerre outputs of each signal, at every so many samples."""
    columns = [np.ones((len(signals[0, ::every]), 1))]
    columns += [_laguerre(signal, pole)[::every] for signal in signals]
    return np.hstack(columns)


def _solve(gram: FloatArray, moments: FloatArray) -> FloatArray:
    """Least squares from scaled normal equations; directions without content are left out."""
    scale = np.sqrt(np.maximum(np.diag(gram), 1e-300))
    values, vectors = np.linalg.eigh(gram / np.outer(scale, scale))
    kept = values > 1e-10 * values[-1]
    weights = vectors[:, kept].T @ (moments / scale) / values[kept]
    return np.asarray(vectors[:, kept] @ weights / scale)


def _laguerre(signal: FloatArray, pole: float) -> FloatArray:
    """Outputs (n_samples, ORDER) of a Laguerre bank, steady at the first value before it."""
    gain = np.sqrt(1.0 - pole**2)
    start = signal[0] * gain / (1.0 - pole)
    output = scipy.signal.lfilter([gain], [1.0, -pole], signal, zi=[start * pole])[0]
    columns = [output]
    for _ in range(ORDER - 1):
        # All-pass (z⁻¹ − p)/(1 − p z⁻¹), of unit gain at rest.
        output = scipy.signal.lfilter(
            [-pole, 1.0], [1.0, -pole], output, zi=[start * (1.0 + pole)]
        )[0]
        columns.append(output)
    return np.column_stack(columns)
