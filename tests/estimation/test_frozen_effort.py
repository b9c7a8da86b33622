"""An effort that freezes again and again must not move the estimates."""

from pathlib import Path

import numpy as np
import pytest

from bags import simulated_arms
from bags.simulated_arms import CONFIG
from idim_iv_ros import IdentificationResult, identify, load_configuration
from idim_iv_ros.recording import JointTopic, read, write_bag

JOINTS = ["joint_1", "joint_2"]
LENGTH = 80  # samples at 1 kHz


@pytest.fixture(scope="module")
def bags(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """The same ten seconds, whole and with an effort of joint 2 that freezes 20 times."""
    record = simulated_arms.record(simulated_arms.arm2(), 1)
    folder = tmp_path_factory.mktemp("frozen")
    frozen = record.effort.copy()
    for start in np.random.default_rng(2).integers(500, 9000, 20):
        frozen[start : start + LENGTH, 1] = frozen[start - 1, 1]
    paths = folder / "whole.mcap", folder / "frozen.mcap"
    for path, effort in zip(paths, (record.effort, frozen), strict=True):
        states = JointTopic("/joint_states", JOINTS, record.time, record.position, None, effort)
        reference = record.position_reference
        topics = [states, JointTopic("/joint_reference", JOINTS, record.time, reference)]
        write_bag(path, topics)
    return paths


def _identified(bag: Path) -> IdentificationResult:
    return identify([bag], load_configuration(CONFIG / "arm2.yaml"))


def _furthest(first: IdentificationResult, second: IdentificationResult) -> float:
    """Largest difference of two estimates, in standard deviations of the first."""
    pairs = zip(first.parameters, second.parameters, strict=True)
    return max(abs(one.value - two.value) / one.std for one, two in pairs)


def test_estimates_stay_within_the_confidence_of_the_whole_recording(bags, monkeypatch) -> None:
    whole, frozen = (_identified(bag) for bag in bags)
    assert _furthest(whole, frozen) < 1.96
    assert not any("freezes" in reason for reason in whole.processing.reasons)
    (warning,) = [reason for reason in frozen.processing.reasons if "freezes" in reason]
    assert warning.startswith("frozen.mcap: effort of joint_2 on /joint_states")
    monkeypatch.setattr(read, "without_frozen", lambda stamped, *_: (stamped, ()))
    assert _furthest(whole, _identified(bags[1])) > 4.0
