"""What the last model still misses is said, and noise is not."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from bags.simulated_arms import arm2
from idim_iv_ros.diagnosis import sentences
from idim_iv_ros.diagnosis.refit.baseline import Baseline, baseline
from idim_iv_ros.diagnosis.refit.noise_floor import NoiseFloor
from idim_iv_ros.diagnosis.result import Stage
from idim_iv_ros.diagnosis.unexplained import unexplained_residual
from tests.estimation.test_simulated_arms import recorded


@pytest.fixture(scope="module")
def data() -> Baseline:
    arm = arm2(seconds=6.0)
    return baseline([recorded(arm, 1)], arm.configuration)


def said(data: Baseline, shares: tuple[float, float], noise: float | None) -> str:
    """Of a model that misses a share of each joint's torque; the noise is a share of that."""
    torque = [float(np.sqrt(np.mean(rows.torque**2))) for rows in data.rows]
    missed = [share * size for share, size in zip(shares, torque, strict=True)]
    stages = [
        Stage(name, dict(zip(data.joints, values, strict=True)), {}, None, "")
        for name, values in (("given", torque), ("last", missed))
    ]
    floors = [NoiseFloor(None if noise is None else noise * each, "repeats", "") for each in missed]
    whole = SimpleNamespace(residuals=[np.array([size, -size]) for size in torque])
    found: Any = SimpleNamespace(whole=whole, floors=floors)
    return sentences.unexplained_residual(data, unexplained_residual(data, found, stages))


def test_joints_that_miss_much_are_listed_the_worst_first(data: Baseline) -> None:
    text = said(data, (0.2, 0.5), 0.1)
    assert "joint_2 (50 % of its torque" in text
    assert "1 more joint" in text
    assert "N m" in text


@pytest.mark.parametrize(
    ("shares", "noise"),
    [((0.2, 0.5), 0.5), ((0.05, 0.02), 0.1), ((0.2, 0.5), None)],
    ids=["noise", "little", "noise unknown"],
)
def test_noise_and_little_are_not(
    data: Baseline, shares: tuple[float, float], noise: float | None
) -> None:
    assert said(data, shares, noise) == ""
