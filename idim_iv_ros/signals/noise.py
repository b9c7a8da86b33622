"""Measurement noise of the torque, seen where the motion has no power."""

from collections.abc import Sequence

import numpy as np
import scipy

from idim_iv_ros.signals.motion import Motion
from idim_iv_ros.types import FloatArray

_SEGMENT = 2.0  # s
_ABOVE = 3.0  # times the decimation cut-off, where only noise is left


def torque_noise(motions: Sequence[Motion]) -> FloatArray:
    """Standard deviation that measurement noise gives a decimated torque row, (n_joints,) N m.

    The power spectral density (Welch) at frequencies well above the decimation cut-off is taken
    for that of white noise, its median over frequency, times the band that the decimation
    filter lets through. Disturbances that live at low frequencies only are not in it.
    """
    variances = []
    for motion in motions:
        rate, factor = motion.signals.rate, motion.decimation.factor
        edge = motion.decimation.edge if factor > 1 else 1.0
        band = edge * rate / (2.0 * factor)
        segment = min(len(motion.torque), max(64, int(_SEGMENT * rate)))
        lowest = min(_ABOVE * band, 0.375 * rate)
        floors = []
        for joint in motion.torque.T:
            frequency, density = scipy.signal.welch(joint, fs=rate, nperseg=segment)
            floors.append(float(np.median(density[frequency >= lowest])))
        variances.append(np.array(floors) * band)
    return np.asarray(np.sqrt(np.mean(variances, axis=0)))
