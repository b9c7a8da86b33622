"""An effort that freezes again and again must not move the estimates."""

import io
import re
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from bags import simulated_arms
from bags.simulated_arms import CONFIG
from idim_iv_ros import IdentificationResult, check, identify, load_configuration
from idim_iv_ros.cli.identify import print_verdict
from idim_iv_ros.recording import JointTopic, read, write_bag
from idim_iv_ros.report import report_html
from tests.report.test_html import Page

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


def _printed(result: IdentificationResult) -> str:
    console = Console(file=io.StringIO(), width=400)
    print_verdict(console, result)
    return console.file.getvalue()


def _furthest(first: IdentificationResult, second: IdentificationResult) -> float:
    """Largest difference of two estimates, in standard deviations of the first."""
    pairs = zip(first.parameters, second.parameters, strict=True)
    return max(abs(one.value - two.value) / one.std for one, two in pairs)


def test_estimates_stay_within_the_confidence_of_the_whole_recording(
    bags: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    whole, frozen = (_identified(bag) for bag in bags)
    assert _furthest(whole, frozen) < 1.96
    assert not any("freezes" in reason for reason in whole.processing.reasons)
    (warning,) = [reason for reason in frozen.processing.reasons if "freezes" in reason]
    assert warning.startswith("frozen.mcap: effort of joint_2 on /joint_states freezes ")
    assert "s after the start" in warning
    assert "freezes" not in _printed(whole)
    assert warning in _printed(frozen)
    assert warning.partition(": ")[2] in re.sub(r"\s+", " ", Page(report_html(frozen)).text)
    monkeypatch.setattr(read, "without_frozen", lambda stamped, *_: (stamped, ()))
    assert _furthest(whole, _identified(bags[1])) > 4.0


def test_check_warns_of_it(bags: tuple[Path, Path]) -> None:
    configuration = load_configuration(CONFIG / "arm2.yaml")
    findings = [
        [
            finding
            for finding in check([bag], configuration).findings
            if "freezes" in finding.sentence
        ]
        for bag in bags
    ]
    assert findings[0] == []
    assert [(finding.where, finding.level) for finding in findings[1]] == [
        ("frozen.mcap", "limited")
    ]
