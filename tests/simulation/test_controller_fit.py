"""Unknown control laws are recovered from what was logged, or replaced by a filter."""

import dataclasses

import numpy as np
import pytest

from bags.simulated_arms import arm6, record
from idim_iv_ros.simulation import (
    filter_reference,
    fit_controller,
    simulate_closed_loop,
)


@pytest.fixture(scope="module")
def arm():
    return arm6()


def fitted(arm, law, **noise):
    recording = record(dataclasses.replace(arm, law=law), 5, **noise)
    fit = fit_controller(
        recording.rate,
        recording.position,
        None,
        recording.truth.torque,
        recording.position_reference,
        recording.velocity_reference,
        torque_limit=law.torque_limit,
    )
    return recording, fit


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


def test_delay_between_error_and_torque_is_found(arm):
    recording, _ = fitted(arm, arm.law, position_noise=1e-6)
    late = np.roll(recording.truth.torque, 2, axis=0)
    fit = fit_controller(
        recording.rate,
        recording.position,
        None,
        late,
        recording.position_reference,
        recording.velocity_reference,
    )
    assert fit.delay == 2


def test_fitted_law_simulates_the_motion_that_was_recorded(arm):
    recording, fit = fitted(arm, arm.law, position_noise=1e-5)
    result = simulate_closed_loop(
        arm.robot,
        arm.truth,
        fit.law(recording.position_reference, recording.velocity_reference),
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
    filtered = filter_reference(recording.rate, recording.position, recording.position_reference)
    unseen = slice(int(0.7 * len(recording.position)), None)
    tracking = (recording.position_reference - recording.position)[unseen]
    assert np.all(filtered.error < 0.6 * np.std(tracking, axis=0))
    assert np.all(filtered.error > 0.5e-4)  # the noise stays
    np.testing.assert_allclose(
        filtered.spread, np.std(recording.position[unseen], axis=0), rtol=0.01
    )
    noise = recording.position - recording.truth.position
    left = filtered.position - recording.truth.position
    for joint in range(6):
        assert abs(np.corrcoef(noise[:, joint], left[:, joint])[0, 1]) < 0.1
