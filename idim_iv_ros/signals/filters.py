"""Band-pass filtering of positions: zero-phase Butterworth and central differences.

Source: paper, section II.C.
"""

import numpy as np
import scipy

from idim_iv_ros.types import FloatArray


def zero_phase_butterworth(
    signal: FloatArray, *, rate: float, cutoff: float, order: int
) -> FloatArray:
    """Low-pass a signal forward and backward, so that it is not delayed.

    Parameters
    ----------
    signal
        (n_samples, n_joints).
    rate, cutoff
        Hz; `cutoff` is that of one pass.
    order
        Of one pass.

    Returns
    -------
    (n_samples, n_joints)

    Raises
    ------
    ValueError
        The signal is shorter than the start-up of the filter.
    """
    sections = scipy.signal.butter(order, cutoff, fs=rate, output="sos")
    padding = 3 * order
    if len(signal) <= padding:
        raise ValueError(f"{len(signal)} samples are too few for a filter of order {order}")
    filtered = np.empty(signal.shape)
    for joint in range(signal.shape[1]):  # one at a time: an hour of all would fill the memory
        filtered[:, joint] = scipy.signal.sosfiltfilt(sections, signal[:, joint], padlen=padding)
    return filtered


def central_differences(
    signal: FloatArray, *, rate: float, start: int = 0, stop: int | None = None
) -> tuple[FloatArray, FloatArray]:
    """First and second derivative by central differences, one-sided at the two ends.

    Velocity is the central difference of position, and acceleration that of velocity.

    Parameters
    ----------
    signal
        (n_samples, n_joints).
    rate
        Hz.
    start, stop
        Samples to return; neighbours outside are used where there are any.

    Returns
    -------
    velocity, acceleration : (stop - start, n_joints)
        Per second, per second squared.
    """
    stop = len(signal) if stop is None else stop
    first, last = max(start - 2, 0), min(stop + 2, len(signal))
    velocity = np.gradient(signal[first:last], 1.0 / rate, axis=0)
    acceleration = np.gradient(velocity, 1.0 / rate, axis=0)
    inside = slice(start - first, stop - first)
    return velocity[inside], acceleration[inside]
