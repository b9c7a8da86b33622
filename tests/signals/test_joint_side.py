"""What no robot has is refused by joint, before its squares leave the range of numbers."""

from pathlib import Path

import numpy as np
import pytest

from idim_iv_ros.configuration import Configuration, ProcessingSection
from idim_iv_ros.errors import DataError
from idim_iv_ros.recording import JointTopic, read_recordings, write_bag
from idim_iv_ros.signals import Cutoffs, filter_motion, joint_side
from idim_iv_ros.signals.joint_side import JointSignals

JOINTS = ["a", "b"]


def side(folder: Path, position: float = 1.0, effort: float = 1.0, **sections):
    time = np.arange(500) / 100.0
    wave = np.sin(np.outer(time, [1.0, 2.0]))
    values = (position * wave, None, wave * [1.0, effort])
    write_bag(folder / "r.mcap", [JointTopic("/joint_states", JOINTS, time, *values)])
    configuration = Configuration.model_validate({"robot": {"joints": JOINTS}, **sections})
    (recording,) = read_recordings([folder / "r.mcap"], joints=JOINTS)
    return joint_side(recording, configuration)


@pytest.mark.parametrize("effort", [1e300, 1e-300, 1e-320])
def test_torque_that_no_robot_has_is_refused_by_joint(tmp_path: Path, effort: float) -> None:
    with pytest.raises(DataError, match=r"r\.mcap: .*(torque of b|holds .* for b)"):
        side(tmp_path, effort=effort)


def test_scale_that_makes_an_impossible_torque_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"torque of b .*effort_scale"):
        side(tmp_path, effort=10.0, signals={"effort_scale": [1.0, 1e9]})


def test_position_that_no_robot_has_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"r\.mcap: .*position"):
        side(tmp_path, position=1e8)


def test_torques_of_small_and_large_robots_are_taken(tmp_path: Path) -> None:
    assert np.abs(side(tmp_path, effort=1e-6).torque[:, 1]).max() == pytest.approx(1e-6, rel=0.01)
    assert np.abs(side(tmp_path, effort=1e6).torque[:, 1]).max() == pytest.approx(1e6, rel=0.01)


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
