"""A law whose speed is a filtered difference of positions: its commands, and its lateness."""

import dataclasses

import numpy as np
import pytest
import scipy

from bags.simulated_arms import SimulatedArm, arm2
from idim_iv_ros.simulation import ClosedLoopResult, SimulatedEffect, factor_of_lateness
from tests.simulation.laws import followed


@pytest.fixture(scope="module")
def arm() -> SimulatedArm:
    return arm2(seconds=2.0)


def pushed(arm: SimulatedArm) -> np.ndarray:
    """A start at another speed than that of the reference."""
    return arm.velocity_reference[0] + 0.1


def filtered(result: ClosedLoopResult, rate: float, factor: float) -> np.ndarray:
    """Speed that a drive computes from what its encoders show, sample by sample."""
    speed = result.measured_velocity[0]
    speeds = [speed]
    for before, now in zip(
        result.measured_position[:-1], result.measured_position[1:], strict=True
    ):
        speed = factor * (now - before) * rate + (1.0 - factor) * speed
        speeds.append(speed)
    return np.array(speeds)


EFFECTS = {
    "none": [],
    "encoder": [SimulatedEffect("encoder_eccentricity", "joint_1", {"cosine": 0.004})],
    "shaft": [SimulatedEffect("elasticity", "joint_2", {"stiffness": 4e3, "damping": 2.0})],
}


@pytest.mark.parametrize("effects", EFFECTS)
@pytest.mark.parametrize("factor", [1.0, 0.3])
def test_commands_are_those_of_a_drive_with_that_filter(arm, factor, effects) -> None:
    law = dataclasses.replace(arm.law, period=None, speed_factor=factor)
    result = followed(arm, *EFFECTS[effects], law=law, initial_velocity=pushed(arm))
    assert result.diverged is None
    error = arm.position_reference - result.measured_position
    slip = arm.velocity_reference - filtered(result, arm.rate, factor)
    wanted = np.clip(law.kp * error + law.kd * slip, -law.torque_limit, law.torque_limit)
    np.testing.assert_allclose(result.torque, wanted, atol=1e-7 * np.abs(wanted).max())


@pytest.mark.parametrize("lateness", [0.5e-3, 0.9e-3, 3.3e-3, 9.5e-3])
def test_the_filter_is_as_late_as_it_is_asked_to_be(lateness: float) -> None:
    period = 1e-3
    factor = factor_of_lateness(lateness, period)
    assert factor is not None
    # The difference and the filter as one: its group delay near zero, in samples.
    zeros, poles = [factor, -factor], [1.0, factor - 1.0]
    low = 1e-4
    _, delay = scipy.signal.group_delay((zeros, poles), [low])
    assert delay[0] * period == pytest.approx(lateness, rel=1e-3)


def test_a_speed_that_differences_cannot_be_early_enough_for_is_exact() -> None:
    assert factor_of_lateness(0.25e-3, 1e-3) is None
