"""When values were sampled: what of the jitter of their stamps is in the positions.

A driver that reads its encoders on a regular clock stamps them when it comes to it. Interpolated
from such stamps, a joint at 1 rad/s has 0.3 mrad of noise for 0.3 ms of jitter, and much more in
its acceleration. Stamps that are right are needed as much: a sample that was taken late shows it.
"""

import numpy as np
import scipy

from idim_iv_ros.types import FloatArray, IntArray

_WANDER = 1.0  # s over which the regular clock may wander from a constant rate
_DRIFT = 25  # samples over which a rate that is a little off does not matter
_LEAST_JITTER = 2e-3  # of an interval
_WINDOW, _ORDER = 9, 3  # samples and order of the local polynomials that positions are smooth by
_BLOCKS = 16  # left out in turn for the deviation
_CLEAR = 3.0  # standard deviations
_RIGHT = 0.9  # share of the jitter in the positions from which on stamps are as good as right


def sampling_times(time: IntArray, position: FloatArray) -> tuple[IntArray, float]:
    """Return when positions (n, k) with stamps `time` (n,), ns, were sampled, (n,) ns.

    Stamps are a clock that is regular over a second, and jitter. A joint that moves shows the share
    of the jitter with which its samples were taken, 1 to 0, which is returned, too: 1, with the
    stamps as they are, unless the positions clearly say less.
    """
    if len(time) < _BLOCKS * _WINDOW:
        return time, 1.0
    steps = np.diff(time)
    interval = float(steps.sum()) / max(float(np.rint(steps / np.median(steps)).sum()), 1.0)
    stamps = (time - time[0]) / interval
    # Jitter of more than half an interval is counted as none or two: the phase drifts by it.
    drift = _phase(stamps, _DRIFT)
    interval *= 1.0 + float(drift[-1] - drift[0]) / float(stamps[-1])
    stamps = (time - time[0]) / interval
    places, phase = _regular_clock(stamps, max(int(1e9 * _WANDER / interval), _WINDOW))
    jitter = stamps - places - phase
    if float(np.std(jitter)) < _LEAST_JITTER:
        return time, 1.0
    share, std = _share_in(position, jitter, places)
    if not share + _CLEAR * std < _RIGHT:
        return time, 1.0
    share = max(share, 0.0)
    return time - np.rint((1.0 - share) * jitter * interval).astype(np.int64), share


def _regular_clock(stamps: FloatArray, width: int) -> tuple[IntArray, FloatArray]:
    """Return places, no two the same, and phases (n,) of stamps (n,), all in intervals."""
    phase = _phase(stamps, width)
    order = np.arange(len(stamps))
    free = scipy.optimize.isotonic_regression(stamps - phase - order).x  # that are passed over
    return np.rint(free).astype(np.int64) + order, phase


def _phase(stamps: FloatArray, width: int) -> FloatArray:
    """Circular mean (n,) of `width` stamps: messages that are missing do not move it."""
    turns = scipy.ndimage.uniform_filter1d(np.exp(2j * np.pi * stamps), width, mode="nearest")
    return np.asarray(np.unwrap(np.angle(turns)) / (2.0 * np.pi))


def _share_in(position: FloatArray, jitter: FloatArray, places: IntArray) -> tuple[float, float]:
    """Share of the jitter (n,), in intervals, that is in the positions, with its deviation.

    The mean of the joints' shares, by the inverse of their variances; that of none is infinite.
    """
    whole = np.convolve(np.diff(places, prepend=places[0] - 1) == 1, np.ones(_WINDOW), "same")
    whole = whole == _WINDOW
    if np.count_nonzero(whole) < _BLOCKS * _WINDOW:
        return 1.0, np.inf
    slope = scipy.signal.savgol_coeffs(_WINDOW, _ORDER, deriv=1)
    edges = np.linspace(0, np.count_nonzero(whole), _BLOCKS, endpoint=False, dtype=int)
    weighted = weights = 0.0
    for joint in position.T[np.isfinite(position).all(axis=0)]:
        speed = scipy.signal.savgol_filter(joint, _WINDOW, _ORDER, deriv=1)
        rough, shown = (
            (x - scipy.signal.savgol_filter(x, _WINDOW, _ORDER))[whole]
            for x in (joint, speed * jitter)
        )
        # Noise of the positions moves nothing by its own speed.
        of_noise = float(np.mean(rough**2)) * float(slope @ slope) * jitter[whole] ** 2
        products = np.add.reduceat(shown * rough, edges)
        squares = np.add.reduceat(shown**2 - of_noise, edges)
        rest = squares.sum() - squares
        if squares.sum() <= 0.0 or np.any(rest <= 0.0):
            continue
        variance = (_BLOCKS - 1) * float(np.var((products.sum() - products) / rest))
        weight = 1.0 / max(variance, 1e-12)
        weighted += weight * float(products.sum() / squares.sum())
        weights += weight
    return (weighted / weights, weights**-0.5) if weights else (1.0, np.inf)
