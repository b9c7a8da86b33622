"""What the last model still misses is said, and noise is not."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from idim_iv_ros.diagnosis import sentences
from idim_iv_ros.diagnosis.answer.explained import unexplained_residual
from idim_iv_ros.diagnosis.refit.baseline import Baseline
from idim_iv_ros.diagnosis.refit.noise_floor import NoiseFloor
from idim_iv_ros.diagnosis.result import Stage


def missed(
    data: Baseline, first: float, shares: tuple[float, float], noise: float | None
) -> list[tuple[int, float, float, float]]:
    """Of a model that misses shares of the torques: joint, rms, share, noise of those said.

    Parameters
    ----------
    first
        What the first model misses of each torque.
    noise
        As a share of what the last one misses.
    """
    stages = [
        Stage(
            name,
            dict(zip(data.joints, share * np.array(data.torque_sizes), strict=True)),
            {},
            None,
            "",
        )
        for name, share in (("given", np.full(2, first)), ("last", np.array(shares)))
    ]
    floors = [
        NoiseFloor(None if noise is None else noise * rms, "repeats", "")
        for rms in stages[-1].torque_rms.values()
    ]
    whole = SimpleNamespace(residuals=[np.array([size, -size]) for size in data.torque_sizes])
    explanation: Any = SimpleNamespace(whole=whole, floors=floors)
    return unexplained_residual(data, explanation, stages)


def test_joints_that_miss_much_are_listed_the_worst_first(data: Baseline) -> None:
    joints = missed(data, 1.0, (0.2, 0.5), 0.1)
    assert [(joint, round(share, 9)) for joint, _, share, _ in joints] == [(1, 0.5), (0, 0.2)]
    text = sentences.unexplained_residual(data, joints)
    assert "joint_2 (50 % of its torque" in text
    assert "1 more joint" in text
    assert "N m" in text


@pytest.mark.parametrize(
    ("first", "shares", "noise", "joints"),
    [
        (1.0, (0.2, 0.5), 0.5, []),  # noise
        (1.0, (0.05, 0.02), 0.1, []),  # little
        (1.0, (0.2, 0.5), None, []),  # of unknown noise
        (0.06, (0.05, 0.001), 0.2, [0]),  # a small share, and most of the first gap
        (0.5, (0.05, 0.001), 0.2, []),
        (0.5, (0.15, 0.001), 0.1, [0]),
        (0.025, (0.025, 0.001), 0.4, []),  # may be noise
    ],
)
def test_noise_and_little_are_not(data, first, shares, noise, joints) -> None:
    assert [joint for joint, *_ in missed(data, first, shares, noise)] == joints
