"""The simulated motion, brought closer to a measured one that another loop made."""

import numpy as np
import pytest

from idim_iv_ros.diagnosis.refit.smooth_motion import corrected_motions, high_passed
from idim_iv_ros.signals import ParallelDecimation

RATE, CUTOFF = 500.0, 20.0


def sines(seconds: float = 20.0, seed: int = 0) -> list[np.ndarray]:
    """Position and its first four derivatives of two joints, (s, 2) each."""
    rng = np.random.default_rng(seed)
    time = np.arange(round(seconds * RATE)) / RATE
    pulsation = 2.0 * np.pi * rng.uniform(0.5, CUTOFF, (2, 25))
    phase = rng.uniform(0.0, 2.0 * np.pi, (2, 25))
    size = 0.3 / pulsation**1.5
    angle = pulsation * time[:, None, None] + phase
    return [
        np.sum(size * pulsation**order * np.sin(angle + 0.5 * np.pi * order), axis=2)
        for order in range(5)
    ]


def other_loop(states: list[np.ndarray], order: int) -> np.ndarray:
    """The same derivative where the loop is 2 % weaker, 3 ms later, and the joints are coupled."""
    crossed = states[order][:, ::-1]
    return (
        0.98 * states[order] - 3e-3 * states[order + 1] + 4e-6 * states[order + 2] + 0.01 * crossed
    )


def difference(one: list[np.ndarray], other: list[np.ndarray]) -> float:
    """Of two accelerations where the motions join and above, as a share of the first's."""
    inner = slice(500, -500)
    rest, whole = (
        high_passed(states, RATE, CUTOFF)[inner] for states in (one[2] - other[2], one[2])
    )
    return float(np.std(rest) / np.std(whole))


@pytest.mark.parametrize("noise", [0.0, 2e-5])
def test_what_another_loop_does_to_the_motion_is_taken_over_without_its_noise(noise) -> None:
    states = sines()
    real = [other_loop(states, order) for order in range(3)]
    rng = np.random.default_rng(1)
    pulsation = 2.0 * np.pi * CUTOFF
    measured = [
        values + noise * pulsation**order * rng.standard_normal(values.shape)
        for order, values in enumerate(real)
    ]
    decimation = ParallelDecimation(10, len(states[0]), 0.8)
    (corrected,) = corrected_motions([measured], [states[:3]], [decimation], [RATE], CUTOFF)
    assert difference(real, states[:3]) > 0.2
    assert difference(real, corrected) < 0.01
    assert difference(real, corrected) <= max(0.2 * difference(real, measured), 1e-3)


def test_with_few_rows_each_joint_alone_counts() -> None:
    """21 rows do not hold six numbers of each joint."""
    states = sines(seconds=1.0)
    measured = [other_loop(states, order) for order in range(3)]
    decimation = ParallelDecimation(24, len(states[0]), 0.8)
    (corrected,) = corrected_motions([measured], [states[:3]], [decimation], [RATE], CUTOFF)
    changed = [states[2].copy() for _ in (0, 1)]
    changed[1][:, 1] = 0.0
    twisted = [*states[:2], changed[1]]
    (other,) = corrected_motions([measured], [twisted], [decimation], [RATE], CUTOFF)
    np.testing.assert_allclose(corrected[2][:, 0], other[2][:, 0])
