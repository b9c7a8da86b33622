"""Control laws for tests: one torque whatever happens, or a plain pd."""

import numpy as np

from idim_iv_ros.simulation import ControlLaw


def pd(kp, kd, ki=0.0, *, limit=np.inf, period=None, delay=0.0, feedforward=None):
    """PD law on n joints (the length of kp)."""
    n = len(kp)
    return ControlLaw(
        type="pd",
        kp=np.asarray(kp, dtype=float),
        kd=np.asarray(kd, dtype=float),
        ki=np.full(n, ki),
        kv=np.zeros(n),
        drive_gain=np.ones(n),
        velocity_reference=True,
        torque_limit=np.full(n, limit),
        period=period,
        delay=delay,
        feedforward=feedforward,
    )


def torque(values):
    """Open loop: the torques (n_samples, n_joints) are applied as they are."""
    values = np.asarray(values, dtype=float)
    return pd(np.zeros(values.shape[1]), np.zeros(values.shape[1]), feedforward=values)
