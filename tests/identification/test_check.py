"""What `check` says of a recording before anything is identified."""

from pathlib import Path

import numpy as np
import pytest

from bags.simulated_arms import arm2, record
from idim_iv_ros.identification.check import check, count_reversals
from idim_iv_ros.recording import JointTopic, write_bag
from tests.configurations import changed

REST = 8.0  # s


@pytest.mark.parametrize(
    ("speed", "count"),
    [
        ([1.0, 0.5, -0.5, -1.0, 0.0, 1.0], 2),
        ([1.0, 0.01, -0.01, 0.01, -0.01, 1.0], 0),  # a stop, and on
        ([1.0, 0.01, -0.01, 0.01, -0.01, -1.0], 1),
        ([0.01, -0.01, 0.01], 0),
    ],
)
def test_a_joint_reverses_where_it_moves_the_other_way(speed: list[float], count: int) -> None:
    assert count_reversals(np.array(speed), 0.05) == count


def reversals(tmp_path: Path, seconds_of_rest: float) -> list[int]:
    """Reversals of the joints that `check` finds in a motion after a rest."""
    arm = arm2(seconds=8.0)
    recording = record(arm, 1, position_noise=5e-5)
    rest = round(seconds_of_rest * recording.rate)
    noise = 5e-5 * np.random.default_rng(2).standard_normal((rest, 2))
    position = np.vstack([recording.truth.position[0] + noise, recording.position])
    effort = np.vstack([np.repeat(recording.effort[:1], rest, axis=0), recording.effort])
    time = np.arange(len(position)) / recording.rate
    path = tmp_path / "motion.mcap"
    joints = arm.configuration.robot.joints
    urdf = arm.configuration.robot.urdf
    assert urdf is not None
    topic = JointTopic("/joint_states", joints, time, position, None, effort)
    write_bag(path, [topic], robot_description=urdf.read_text(encoding="utf-8"))
    report = check([path], changed(arm.configuration, "signals", reference=None))
    sentences = [finding.sentence for finding in report.findings if "reversals" in finding.sentence]
    return [int(sentence.split(", ")[-1].split()[0]) for sentence in sentences]


def test_the_noise_of_a_joint_at_rest_is_no_reversal(tmp_path: Path) -> None:
    moving = reversals(tmp_path, 0.0)
    assert all(3 <= count <= 40 for count in moving)
    resting = reversals(tmp_path, REST)
    assert all(abs(more - count) <= 1 for more, count in zip(resting, moving, strict=True))
