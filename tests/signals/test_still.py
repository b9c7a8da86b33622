"""A robot at rest is at rest, whatever its encoders show of it."""

import numpy as np
import pytest

from idim_iv_ros.configuration import ProcessingSection
from idim_iv_ros.errors import DataError
from idim_iv_ros.signals import Cutoffs, filter_motion
from idim_iv_ros.signals.joint_side import JointSignals

RATE, SAMPLES = 500.0, 2000
NOISE = np.random.default_rng(5).standard_normal(SAMPLES)
ONCE = np.arange(SAMPLES) > 1200  # from one encoder step to the next, and no other
CUTOFFS = Cutoffs(40.0, 16.0, (10,), 50.0, ())


def refusal(*positions: np.ndarray) -> str:
    """What is said of joints that all stand still."""
    position = 0.0145 + np.column_stack(positions)
    valid = np.ones(position.shape, dtype=bool)
    signals = JointSignals("bag", RATE, position, NOISE[:, None] + position, valid, *[None] * 3)
    joints = [f"joint_{number + 1}" for number in range(len(positions))]
    with pytest.raises(DataError, match="no joint moves") as refused:
        filter_motion([signals], ProcessingSection(), CUTOFFS, joints)
    return str(refused.value)


@pytest.mark.parametrize(
    "position",
    [
        7e-5 * np.round(0.35 * NOISE),  # the encoder of the report: to and fro over a step
        1.5e-3 * np.round(0.3 * NOISE),  # 12 bits
        1.5e-3 * ONCE,
        5e-3 * NOISE,  # a potentiometer
        0.7 * (np.arange(SAMPLES) == 1000) + 2e-4 * NOISE,  # a sensor that jumps
    ],
)
def test_neither_noise_nor_a_step_nor_a_jump_of_a_sensor_is_a_motion(position) -> None:
    assert "joint_1 over" in refusal(position, np.zeros(SAMPLES))
