"""Recordings of MuJoCo's position servos: commands and 12 bit positions, no efforts."""

from pathlib import Path

import numpy as np
import pytest

from benchmarks.servos import URDF, mujoco_servo
from idim_iv_ros.recording.writing.write import JointTopic, write_bag
from idim_iv_ros.servo.fit import Motion


@pytest.fixture(scope="session")
def motion() -> Motion:
    return mujoco_servo(100.0, 12.0, seed=4)


@pytest.fixture(scope="session")
def servo_folder(tmp_path_factory: pytest.TempPathFactory, motion: Motion) -> Path:
    """A bag, the URDF and the configuration of one servo."""
    folder = tmp_path_factory.mktemp("servo")
    write_servo_bag(folder / "run.mcap", motion)
    (folder / "servo.urdf").write_text(URDF)
    (folder / "servo_arm.yaml").write_text(
        "robot: {urdf: servo.urdf, joints: [j]}\n"
        "signals: {joint_states: joint_states, effort: none, reference: command}\n"
    )
    return folder


def write_servo_bag(path: Path, motion: Motion, scale: float = 1.0) -> None:
    time = np.arange(len(motion.command)) / motion.rate
    states = JointTopic("joint_states", ["j"], time, scale * motion.position)
    write_bag(path, [states, JointTopic("command", ["j"], time, scale * motion.command)])
