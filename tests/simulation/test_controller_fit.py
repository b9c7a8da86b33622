"""The control law of a recording: its gains, its delays, and the speed that it sees."""

import dataclasses

import numpy as np
import pytest
import scipy

from bags.simulated_arms import SimulatedArm, arm2, arm6, record
from idim_iv_ros.configuration import ControllerSection
from idim_iv_ros.errors import UsageError
from idim_iv_ros.signals.joint_side import JointSignals
from idim_iv_ros.simulation import (
    ClosedLoopResult,
    SimulatedEffect,
    control_law,
    factor_of_lateness,
    filter_reference,
    fit_controller,
    simulate_closed_loop,
)
from tests.simulation.laws import followed


@pytest.fixture(scope="module")
def arm():
    return arm6()


def fitted(arm, law, **noise):
    recording = record(dataclasses.replace(arm, law=law), 5, **noise)
    signals = signals_of(recording, recording.truth.torque)
    return recording, fit_controller(signals, torque_limit=law.torque_limit)


def signals_of(recording, torque):
    return JointSignals(
        "made",
        recording.rate,
        recording.position,
        torque,
        np.ones(torque.shape, dtype=bool),
        position_reference=recording.position_reference,
        velocity_reference=recording.velocity_reference,
    )


def test_pd_gains_of_a_simulated_arm_are_found_through_encoder_noise(arm):
    _, fit = fitted(arm, arm.law, position_noise=1e-5)
    np.testing.assert_allclose(fit.gain("kp"), arm.law.kp, rtol=0.01)
    np.testing.assert_allclose(fit.gain("kd"), arm.law.kd, rtol=0.03)
    assert np.all(fit.r_squared > 0.99)
    assert fit.delay == 0
    assert not np.any(fit.included[:, fit.terms.index("ki")])


def test_integral_term_enters_where_the_law_has_one(arm):
    law = dataclasses.replace(arm.law, ki=10.0 * arm.law.kp)
    _, fit = fitted(arm, law, position_noise=1e-6)
    np.testing.assert_allclose(fit.gain("ki"), law.ki, rtol=0.05)


def test_law_without_velocity_reference_shows_as_minus_kd_on_it(arm):
    law = dataclasses.replace(arm.law, velocity_reference=False)
    _, fit = fitted(arm, law, position_noise=1e-6)
    np.testing.assert_allclose(fit.gain("reference_velocity"), -law.kd, rtol=0.03)


@pytest.mark.parametrize(("integral", "delay"), [(0.0, 2), (10.0, 0), (10.0, 2)])
def test_delay_is_found_also_where_an_integral_carries_the_load(arm, integral, delay):
    law = dataclasses.replace(arm.law, ki=integral * arm.law.kp)
    recording, _ = fitted(arm, law, position_noise=1e-6)
    late = np.roll(recording.truth.torque, delay, axis=0)
    assert fit_controller(signals_of(recording, late)).delay == delay


def test_fitted_law_simulates_the_motion_that_was_recorded(arm):
    recording, fit = fitted(arm, arm.law, position_noise=1e-5)
    result = simulate_closed_loop(
        arm.robot,
        arm.truth,
        fit.law(signals_of(recording, recording.truth.torque)),
        rate=recording.rate,
        position_reference=recording.position_reference,
        velocity_reference=recording.velocity_reference,
        initial_position=recording.truth.position[0],
        initial_velocity=recording.truth.velocity[0],
    )
    error = np.abs(result.position - recording.truth.position).max(axis=0)
    tracking = np.abs(recording.position_reference - recording.truth.position).max(axis=0)
    assert np.all(error < 0.05 * tracking)


def test_filtered_reference_explains_the_tracking_error_and_not_the_noise(arm):
    recording = record(arm, 3, position_noise=1e-4)
    position, error, spread = filter_reference(
        recording.rate, recording.position, recording.position_reference
    )
    unseen = slice(int(0.7 * len(recording.position)), None)
    tracking = (recording.position_reference - recording.position)[unseen]
    assert np.all(error < 0.6 * np.std(tracking, axis=0))
    assert np.all(error > 0.5e-4)  # the noise stays
    np.testing.assert_allclose(spread, np.std(recording.position[unseen], axis=0), rtol=0.01)
    noise = recording.position - recording.truth.position
    left = position - recording.truth.position
    for joint in range(6):
        assert abs(np.corrcoef(noise[:, joint], left[:, joint])[0, 1]) < 0.1


@pytest.fixture(scope="module")
def quick() -> SimulatedArm:
    return arm2(seconds=2.0)


def pushed(quick: SimulatedArm) -> np.ndarray:
    """A start at another speed than that of the reference."""
    return quick.velocity_reference[0] + 0.1


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
def test_commands_are_those_of_a_drive_with_that_filter(quick, factor, effects) -> None:
    law = dataclasses.replace(quick.law, period=None, speed_factor=factor)
    result = followed(quick, *EFFECTS[effects], law=law, initial_velocity=pushed(quick))
    assert result.diverged is None
    error = quick.position_reference - result.measured_position
    slip = quick.velocity_reference - filtered(result, quick.rate, factor)
    wanted = np.clip(law.kp * error + law.kd * slip, -law.torque_limit, law.torque_limit)
    np.testing.assert_allclose(result.torque, wanted, atol=1e-7 * np.abs(wanted).max())


@pytest.mark.parametrize("lateness", [0.5e-3, 0.9e-3, 3.3e-3, 9.5e-3])
def test_the_filter_is_as_late_as_it_is_asked_to_be(lateness: float) -> None:
    period = 1e-3
    factor = factor_of_lateness(lateness, period)
    # The difference and the filter as one: its group delay near zero, in samples.
    zeros, poles = [factor, -factor], [1.0, factor - 1.0]
    _, delay = scipy.signal.group_delay((zeros, poles), [1e-4])
    assert delay[0] * period == pytest.approx(lateness, rel=1e-3)


def test_a_speed_that_differences_cannot_be_early_enough_for_is_exact() -> None:
    assert factor_of_lateness(0.25e-3, 1e-3) is None


def test_unknown_law_cannot_be_built_from_a_configuration() -> None:
    with pytest.raises(UsageError, match=r"controller\.type is unknown"):
        control_law(ControllerSection(), 2)
