"""A link behind a shaft or a play, against SciPy's integration of the same two masses."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from idim_iv_ros.diagnosis.refit.smooth_motion import SmoothMotion
from idim_iv_ros.effects.two_masses import transmitted

RATE, INERTIA, COUPLED = 500.0, 0.4, 0.15
TIME = np.arange(2000) / RATE
STIFFNESS = INERTIA * (2.0 * np.pi * 9.0) ** 2
DAMPING = 0.3 * np.sqrt(STIFFNESS * INERTIA)


def load_at(time: np.ndarray | float) -> Any:
    return 3.0 * np.sin(2.0 * np.pi * 0.8 * time) + 1.2 * np.sin(2.0 * np.pi * 3.0 * time)


def constant_link(slope: float = 0.0) -> SmoothMotion:
    """Inertias and slopes of the load do not change."""
    inertia = np.array([[1.0, COUPLED], [COUPLED, INERTIA]])
    slopes = np.tile([0.3 * slope, slope], (len(TIME), 1))
    made: Any = SimpleNamespace(
        rate=RATE,
        inertia=np.tile(inertia, (len(TIME), 1, 1)),
        load=np.column_stack([np.zeros_like(TIME), load_at(TIME)]),
        slope=lambda joint: slopes,
    )
    return cast(SmoothMotion, made)


def integrated(gap: float, slope: float, start: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Given torque, shift, its acceleration: M δ̈ = T − τ − τ' δ, flanks push only."""

    def given(shift: float, speed: float) -> float:
        bent = shift - min(max(shift, -gap / 2), gap / 2)
        if gap > 0.0 and bent == 0.0:
            return 0.0
        torque = -STIFFNESS * bent - DAMPING * speed
        return 0.0 if gap > 0.0 and torque * bent > 0.0 else torque

    def change(time: float, state: np.ndarray) -> list[float]:
        shift, speed = state
        return [speed, (given(shift, speed) - load_at(time) - slope * shift) / INERTIA]

    solution = solve_ivp(
        change, (0.0, TIME[-1]), [start, 0.0], t_eval=TIME, rtol=1e-8, atol=1e-11, max_step=1e-3
    )
    torque = np.array([given(*state) for state in solution.y.T])
    return torque, solution.y[0], (torque - load_at(TIME) - slope * solution.y[0]) / INERTIA


def relative(torque: np.ndarray, expected: np.ndarray) -> float:
    return float(np.linalg.norm(torque - expected) / np.linalg.norm(expected))


@pytest.mark.parametrize("slope", [0.0, 40.0])
def test_shaft_is_that_of_scipy(slope: float) -> None:
    motion = constant_link(slope)
    torque, shift, acceleration = integrated(0.0, slope, 0.0)
    torques = transmitted(motion, 1, STIFFNESS, DAMPING, 0.0)
    assert relative(torques[1][:, 0], torque - load_at(TIME)) < 0.03
    assert relative(torques[0][:, 0], COUPLED * acceleration + 0.3 * slope * shift) < 0.03


def test_play_is_that_of_scipy_and_leaves_the_flank() -> None:
    gap = 0.01
    torque, _, acceleration = integrated(gap, 0.0, -gap / 2)
    torques = transmitted(constant_link(), 1, STIFFNESS, DAMPING, gap)
    assert np.mean(torque == 0.0) > 0.05  # it flies
    assert relative(torques[1][:, 0], torque - load_at(TIME)) < 0.1
    assert relative(torques[0][:, 0], COUPLED * acceleration) < 0.1


def test_a_stiff_shaft_without_play_changes_nothing() -> None:
    torques = transmitted(constant_link(), 1, 1e4 * STIFFNESS, 1e2 * DAMPING, 0.0)
    assert np.abs(torques[1][50:]).max() < 1e-2 * np.abs(load_at(TIME)).max()


def test_torque_behind_a_shaft_is_not_ahead_of_its_time() -> None:
    """Of a shaft far above the motion, T − τ ≈ −M τ̈ / k: in phase with τ̈, nothing with τ̇."""
    stiffness = INERTIA * (2.0 * np.pi * 60.0) ** 2
    torques = transmitted(constant_link(), 1, stiffness, 0.3 * np.sqrt(stiffness * INERTIA), 0.0)
    change = torques[1][100:-100, 0]
    rate = np.gradient(load_at(TIME), 1.0 / RATE)
    second = np.gradient(rate, 1.0 / RATE)[100:-100]
    rate = rate[100:-100]
    delay, compliance = np.linalg.lstsq(np.column_stack([rate, second]), change, rcond=None)[0]
    assert abs(delay) < 0.1 / RATE
    assert compliance == pytest.approx(-INERTIA / stiffness, rel=0.15)
