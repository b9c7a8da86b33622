"""What no robot has is refused by joint, before its squares leave the range of numbers."""

from pathlib import Path

import numpy as np
import pytest

from idim_iv_ros.configuration import Configuration
from idim_iv_ros.errors import DataError
from idim_iv_ros.recording import JointTopic, read_recordings, write_bag
from idim_iv_ros.signals import joint_side

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
