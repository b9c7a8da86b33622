"""Bandwidth of the position loops, for the upper end of a multisine."""

import numpy as np

from idim_iv_ros.configuration import ControllerSection
from idim_iv_ros.types import FloatArray

UNKNOWN_BANDWIDTH = 6.0  # Hz, where the controller is not known


def loop_bandwidth(controller: ControllerSection, inertia: FloatArray) -> tuple[FloatArray, bool]:
    """Bandwidth of the position loops (n_joints,) Hz, and whether it is known.

    pd: √(kp / inertia) / 2π; cascade: kp / 2π; unknown controllers: 6 Hz.
    """
    if controller.kp is None:
        return np.full(len(inertia), UNKNOWN_BANDWIDTH), False
    gain = np.asarray(controller.kp, dtype=float)
    if controller.type == "cascade":
        return gain / (2.0 * np.pi), True
    return np.sqrt(gain / np.maximum(inertia, 1e-9)) / (2.0 * np.pi), True
