"""Bags of two simulated arms, short, and one file that is no bag."""

from dataclasses import dataclass
from pathlib import Path

import pytest

from bags import simulated_arms
from idim_iv_ros.recording.writing.write import JointTopic, write_bag

CONFIG = Path(__file__).resolve().parents[2] / "config" / "arm2.yaml"
RATE, SECONDS = 250.0, 8.0


@dataclass(frozen=True)
class BagFolder:
    """``arm-1/run-1.mcap``, ``arm-1/run-2.mcap``, ``arm-2/run-1.mcap``; ``arm-2/torn.mcap``."""

    path: Path
    bags: tuple[Path, ...]
    corrupt: Path
    topics: tuple[JointTopic, ...]  # of the first bag


@pytest.fixture(scope="session")
def folder(tmp_path_factory: pytest.TempPathFactory) -> BagFolder:
    path = tmp_path_factory.mktemp("fleet")
    arm = simulated_arms.arm2(seconds=SECONDS, rate=RATE)
    bags, topics = [], []
    for seed, name in enumerate(("arm-1/run-1", "arm-1/run-2", "arm-2/run-1"), start=1):
        bag = path / f"{name}.mcap"
        bag.parent.mkdir(exist_ok=True)
        topics.append(simulated_arms.joint_topics(arm, simulated_arms.record(arm, seed)))
        write_bag(bag, topics[-1])
        bags.append(bag)
    corrupt = path / "arm-2" / "torn.mcap"
    corrupt.write_bytes(bags[0].read_bytes()[:300])
    return BagFolder(path, tuple(bags), corrupt, tuple(topics[0]))
