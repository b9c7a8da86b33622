"""Instruments without a control law: the reference through a fitted closed-loop filter."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

FloatArray = NDArray[np.float64]

ORDER = 4
# Bandwidths of the filter that are tried, as fractions of the sampling rate.
BANDWIDTHS = np.geomspace(1e-3, 0.2, 24)


@dataclass(frozen=True)
class ReferenceFilter:
    """Positions that a linear closed loop would take, fitted to the measured ones.

    Attributes
    ----------
    position : (n_samples, n_joints)
        rad or m.
    velocity, acceleration : (n_samples, n_joints)
        Central differences of `position`.
    fit_percent : (n_joints,)
        100 (1 − ‖e − ê‖/‖e − mean e‖) of the tracking error e = reference − position; the fit of
        the position itself is near 100 % for any robot that follows.
    bandwidth : (n_joints,)
        Pole of the filter, Hz.
    """

    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    fit_percent: FloatArray
    bandwidth: FloatArray


def filter_reference(
    rate: float, position: FloatArray, position_reference: FloatArray
) -> ReferenceFilter:
    """Fit, joint by joint, the linear filter from reference to position.

    The tracking error is expanded in discrete Laguerre filters of the reference velocity and a
    constant. The reference is free of noise, so that least squares has no bias from that of the
    position, however coloured (Ljung, System Identification, section 4.2: output-error models
    linear in their parameters).

    Parameters
    ----------
    rate
        Hz.
    position, position_reference
        (n_samples, n_joints) rad or m.
    """
    error = position_reference - position
    speed = np.gradient(position_reference, 1.0 / rate, axis=0)
    explained = np.zeros_like(error)
    fit, bandwidth = np.zeros(error.shape[1]), np.zeros(error.shape[1])
    for joint in range(error.shape[1]):
        target = error[:, joint]
        energies = np.full(len(BANDWIDTHS), np.inf)
        candidates = []
        for k, fraction in enumerate(BANDWIDTHS):
            columns = _laguerre(speed[:, joint], np.exp(-2.0 * np.pi * fraction))
            solution = np.linalg.lstsq(columns, target, rcond=None)[0]
            candidates.append(columns @ solution)
            energies[k] = np.sum((target - candidates[k]) ** 2)
        best = int(np.argmin(energies))
        explained[:, joint] = candidates[best]
        bandwidth[joint] = BANDWIDTHS[best] * rate
        spread = float(np.sum((target - target.mean()) ** 2))
        fit[joint] = 100.0 * (1.0 - np.sqrt(energies[best] / spread)) if spread > 0.0 else 100.0
    simulated = position_reference - explained
    velocity = np.gradient(simulated, 1.0 / rate, axis=0)
    acceleration = np.gradient(velocity, 1.0 / rate, axis=0)
    return ReferenceFilter(simulated, velocity, acceleration, fit, bandwidth)


def _laguerre(signal: FloatArray, pole: float) -> FloatArray:
    """Outputs (n_samples, ORDER + 1) of a Laguerre bank, and a column of ones."""
    gain = np.sqrt(1.0 - pole**2)
    # At rest before the record: the bank starts in the steady state of the first value.
    start = signal[0] * gain / (1.0 - pole)
    output = lfilter([gain], [1.0, -pole], signal, zi=[start * pole])[0]
    columns = [output]
    for _ in range(ORDER - 1):
        first = output[0]
        # All-pass (z⁻¹ − p)/(1 − p z⁻¹) has unit gain at rest.
        output = lfilter([-pole, 1.0], [1.0, -pole], output, zi=[first * (1.0 + pole)])[0]
        columns.append(output)
    columns.append(np.ones(len(signal)))
    return np.column_stack(columns)
