"""How long a zero-phase filter has to wait for what comes after a sample.

Run backward over a record that ends at a time L after a sample, the filter lacks what its impulse
response h would have taken from later: the error is at most 2 Σ_{k > L} |h_k| times the largest
value of the signal (the record is continued by an odd reflection, whose acceleration is bounded by
that of the motion). With that sum below `tolerance`, a sample that waits for L agrees with the
filter over the whole recording to twice that share.
"""

import numpy as np
import scipy

from idim_iv_ros.types import FloatArray

_LONGEST = 60.0  # time constants of the slowest pole, in which every response has decayed


def settling_samples(sections: FloatArray, tolerance: float) -> int:
    """Samples after which less than `tolerance` of an impulse response's Σ |h| remains.

    Parameters
    ----------
    sections : (n, 6)
        Second-order sections of one pass, as of SciPy.
    tolerance
        Share of Σ |h_k|.
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
    sections = scipy.signal.butter(order, cutoff, fs=rate, output="sos")
    return settling_samples(sections, tolerance)
