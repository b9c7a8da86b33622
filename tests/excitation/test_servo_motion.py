"""The motion for servos stays within its limits, begins and ends at rest, and is fast."""

from pathlib import Path

import numpy as np

from idim_iv_ros import load_configuration
from idim_iv_ros.excitation import load_model, motion_limits, servo_motion

CONFIG = Path(__file__).resolve().parents[2] / "config" / "arm6.yaml"


def test_motion_uses_its_limits_and_keeps_them():
    configuration = load_configuration(CONFIG)
    limits = motion_limits(load_model(configuration), configuration)
    motion, highest, document = servo_motion(configuration, limits, rate=100.0, seed=1)
    assert motion.duration == 20.0 and highest == 2.0 and document["purpose"] == "servo"
    assert (motion.position >= limits.lower).all() and (motion.position <= limits.upper).all()
    speed, acceleration = np.abs(motion.velocity), np.abs(motion.acceleration)
    assert (speed <= limits.velocity).all() and (acceleration <= limits.acceleration).all()
    np.testing.assert_allclose(motion.velocity[[0, -1]], 0.0, atol=1e-9)
    reversals = (np.diff(np.sign(motion.velocity), axis=0) != 0).sum(axis=0)
    assert (reversals >= 10).all()
