"""Filtering of positions (zero-phase Butterworth), central differences, and shifts in time.

Source: paper, section II.C.
"""

from functools import lru_cache
from typing import Literal

import numpy as np
import scipy

from idim_iv_ros.types import FloatArray

_SHIFT_SPLINE = 5  # order of the interpolation between samples
_SHIFT_ENDS = 12  # samples by which ends are repeated, beside the shift

# Numbers that are filtered together: for few the calls take longer than the work.
_AT_ONCE = 100_000
_LONGEST = 60.0  # time constants of the slowest pole, in which every response has decayed


def zero_phase_butterworth(
    signal: FloatArray, *, rate: float, cutoff: float, order: int
) -> FloatArray:
    """Low-pass a signal forward and backward, so that it is not delayed.

    `signal`: (n_samples, n_joints). `rate`, `cutoff`: Hz; `cutoff` is that of one pass. `order`: of
    one pass. Returns (n_samples, n_joints).

    Raises ValueError: the signal is shorter than the start-up of the filter.
    """
    sections = _sections(order, cutoff, rate)
    padding = 3 * order
    if len(signal) <= padding:
        raise ValueError(f"{len(signal)} samples are too few for a filter of order {order}")
    if signal.size <= _AT_ONCE:
        return np.asarray(scipy.signal.sosfiltfilt(sections, signal, axis=0, padlen=padding))
    filtered = np.empty(signal.shape)
    for joint in range(signal.shape[1]):  # one at a time: an hour of all would fill the memory
        filtered[:, joint] = scipy.signal.sosfiltfilt(sections, signal[:, joint], padlen=padding)
    return filtered


@lru_cache(maxsize=16)
def _sections(order: int, cutoff: float, rate: float) -> FloatArray:
    return np.asarray(scipy.signal.butter(order, cutoff, fs=rate, output="sos"))


def settling_samples(sections: FloatArray, tolerance: float) -> int:
    """Samples after which less than `tolerance` of an impulse response's Σ |h| remains.

    Run backward over a record that ends at a time L after a sample, a filter lacks what h would
    have taken from later: the error is at most 2 Σ_{k > L} |h_k| times the largest value of the
    signal (the record is continued by an odd reflection), twice `tolerance` for a sample that waits
    for L. `sections` (n, 6): second-order sections of one pass, as of SciPy.
    """
    poles = np.abs(np.concatenate([np.roots(section[3:]) for section in sections]))
    length = int(_LONGEST / -np.log(min(poles.max(), 1.0 - 1e-9))) + 2
    impulse = np.zeros(length)
    impulse[0] = 1.0
    response = np.abs(scipy.signal.sosfilt(sections, impulse))
    remaining = np.cumsum(response[::-1])[::-1]
    return int(np.argmax(remaining < tolerance * remaining[0]))


def butterworth_samples(rate: float, cutoff: float, order: int, tolerance: float) -> int:
    """Return `settling_samples` of the Butterworth filter of `zero_phase_butterworth`."""
    return settling_samples(_sections(order, cutoff, rate), tolerance)


def shifted(values: FloatArray, seconds: float, rate: float) -> FloatArray:
    """Channels (s, …) of `rate`, Hz, that are `seconds` later; their ends are repeated.

    All samples move by the same time, so that the weights of the spline are one filter: four times
    as fast as `scipy.ndimage.shift`.
    """
    count, taps = len(values), _SHIFT_SPLINE + 1
    by = float(np.clip(seconds * rate, -count, count))
    whole = int(np.ceil(by))
    ends = abs(whole) + _SHIFT_ENDS
    lines = np.pad(values.reshape(count, -1).T, ((0, 0), (ends, ends)), mode="edge")
    spline = scipy.ndimage.spline_filter1d(lines, _SHIFT_SPLINE, axis=1, mode="mirror")
    bump = scipy.interpolate.BSpline.basis_element(np.arange(taps + 1.0))
    weights = bump(whole - by + np.arange(taps)[::-1])
    first = ends - whole - taps // 2 + 1
    used = spline[:, first : first + count + taps - 1]
    moved = np.array([np.correlate(line, weights, "valid") for line in used])
    return moved.T.reshape(values.shape)


def central_differences(
    signal: FloatArray,
    *,
    rate: float,
    start: int = 0,
    stop: int | None = None,
    order: Literal[2, 4] = 2,
) -> tuple[FloatArray, FloatArray]:
    """First and second derivative by central differences, one-sided at the two ends.

    Velocity is the difference of position, and acceleration that of velocity. Over three samples
    (order 2, as in the paper) a motion at f loses (2π f / rate)² / 6 of its velocity and twice that
    of its acceleration: 12 % at a tenth of the rate. Over five (order 4) that is 1 %.

    `signal`: (n_samples, n_joints); `rate`: Hz. `start`, `stop`: samples to return; neighbours
    outside are used where there are any. `order`: of the error, in the time between two samples.
    Returns velocity, acceleration (stop - start, n_joints): per second, per second squared.
    """
    stop = len(signal) if stop is None else stop
    first, last = max(start - order, 0), min(stop + order, len(signal))
    velocity = _slopes(signal[first:last], rate, order)
    acceleration = _slopes(velocity, rate, order)
    inside = slice(start - first, stop - first)
    return velocity[inside], acceleration[inside]


def _slopes(signal: FloatArray, rate: float, order: Literal[2, 4]) -> FloatArray:
    """Central differences of an order; of order 2 for the two samples at either end."""
    if order == 2 or len(signal) < 5:
        return np.asarray(np.gradient(signal, 1.0 / rate, axis=0))
    slopes = np.gradient(signal, 1.0 / rate, axis=0, edge_order=2)
    near, far = signal[3:-1] - signal[1:-3], signal[4:] - signal[:-4]
    slopes[2:-2] = rate * (8.0 * near - far) / 12.0
    return np.asarray(slopes)
