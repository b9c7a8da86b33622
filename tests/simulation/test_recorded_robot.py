"""A simulated robot's recording: what is in it, and that its torque fits its motion."""

import dataclasses

import numpy as np
import pinocchio as pin
import pytest
from scipy.signal import welch

from bags.simulated_arms import arm2, record
from idim_iv_ros.model.parameters import parameter_layout
from idim_iv_ros.model.regressor import StandardRegressor
from idim_iv_ros.simulation import inverse_dynamics, mass_matrix
from tests.simulation.trees import TREES, frictionless, random_robot


@pytest.fixture(scope="module")
def arm():
    return arm2(seconds=4.0)


def test_noise_has_the_size_that_was_asked_for(arm):
    recording = record(arm, 1, position_noise=3e-4, torque_noise=[0.5, 0.2])
    quiet = record(arm, 1, position_noise=0.0, torque_noise=0.0)
    assert np.std(recording.position - quiet.position) == pytest.approx(3e-4, rel=0.03)
    noise = recording.effort - quiet.effort
    np.testing.assert_allclose(noise.std(axis=0), [0.5, 0.2], rtol=0.05)


def test_encoder_shows_whole_steps(arm):
    recording = record(arm, 1, position_noise=0.0, encoder_resolution=1e-3)
    steps = recording.position / 1e-3
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-9)
    assert np.abs(recording.position - recording.truth.position).max() <= 0.5001e-3


def test_disturbance_has_its_size_and_bandwidth_and_shows_in_the_effort(arm):
    """The controller answers it: effort and motion together hold it, to the last N m."""
    recording = record(
        arm, 1, position_noise=0.0, torque_noise=0.0, disturbance=np.array([1.5, 0.4])
    )
    truth = recording.truth
    needed = inverse_dynamics(
        arm.robot, arm.truth, truth.position, truth.velocity, truth.acceleration
    )
    acting = needed - truth.torque
    np.testing.assert_allclose(acting[200:].std(axis=0), [1.5, 0.4], rtol=0.25)
    frequency, density = welch(acting[:, 0], fs=arm.rate, nperseg=500)
    low = density[(frequency > 1.0) & (frequency < 5.0)].mean()
    at_cutoff = density[(frequency > 8.0) & (frequency < 12.0)].mean()
    assert 0.25 < at_cutoff / low < 0.8


def test_stamps_jitter_but_never_turn_back(arm):
    recording = record(arm, 1, stamp_jitter=4e-4)
    error = recording.time - np.arange(len(recording.time)) / arm.rate
    assert np.std(error) == pytest.approx(3.3e-4, rel=0.1)  # clipped at 0.45 ms
    assert np.all(np.diff(recording.time) > 0.0)
    np.testing.assert_array_equal(recording.effort, record(arm, 1).effort)


@pytest.mark.parametrize("ratio", [1, 3])
def test_effort_is_in_phase_with_the_motion_whatever_the_control_rate(arm, ratio):
    law = dataclasses.replace(arm.law, period=1.0 / (arm.rate * ratio))
    smooth = dataclasses.replace(arm.truth, coulomb=np.zeros(2))
    recording = record(
        dataclasses.replace(arm, law=law, truth=smooth), 0, position_noise=0.0, torque_noise=0.0
    )
    truth = recording.truth
    needed = inverse_dynamics(
        arm.robot, smooth, truth.position, truth.velocity, truth.acceleration
    )[::ratio]
    middle = slice(1000, -10)
    error = recording.effort[middle] - needed[middle]
    assert np.abs(error).max() < 2e-3 * np.abs(needed).max()
    slope = np.gradient(needed, axis=0)[middle]
    shift = np.sum(error * slope, axis=0) / np.sum(slope * slope, axis=0)
    assert np.all(np.abs(shift) < 0.02), "samples of delay"


@pytest.fixture(params=TREES, ids=lambda name: name.replace(" ", "-"))
def robot(request):
    return random_robot(3, *TREES[request.param])


def states(robot, seed=0, samples=5):
    rng = np.random.default_rng(seed)
    return (
        rng.normal(size=(3, samples, len(robot.joints))) * np.array([2.0, 3.0, 5.0])[:, None, None]
    )


def test_torque_of_a_motion_is_that_of_pinocchio(robot):
    q, dq, ddq = states(robot)
    torque = inverse_dynamics(robot, robot.given, q, dq, ddq)
    data = robot.pinocchio.createData()
    for k in range(len(q)):
        expected = pin.rnea(robot.pinocchio, data, *(x[k, robot.order] for x in (q, dq, ddq)))
        np.testing.assert_allclose(torque[k, robot.order], expected, rtol=1e-11, atol=1e-10)


def test_mass_matrix_is_that_of_pinocchio(robot):
    q, _, _ = states(robot)
    mass = mass_matrix(robot, robot.given, q)
    data = robot.pinocchio.createData()
    for k in range(len(q)):
        upper = np.triu(pin.crba(robot.pinocchio, data, q[k, robot.order]))
        expected = upper + np.triu(upper, 1).T
        actual = mass[k][np.ix_(robot.order, robot.order)]
        np.testing.assert_allclose(actual, expected, rtol=1e-11, atol=1e-10)


def test_unphysical_parameters_act_linearly_as_in_the_regressor(robot):
    n = len(robot.joints)
    rng = np.random.default_rng(7)
    inertial = rng.normal(size=(n, 10))
    inertial[:, 0] = 0.0
    parameters = dataclasses.replace(
        frictionless(inertial),
        drive_inertia=rng.normal(size=n),
        viscous=rng.normal(size=n),
        coulomb=rng.normal(size=n),
        offset=rng.normal(size=n),
    )
    layout = parameter_layout(
        robot.joint_types, friction=("viscous", "coulomb", "offset"), drive_inertia=True
    )
    q, dq, ddq = states(robot)
    expected = StandardRegressor(robot, layout)(q, dq, ddq) @ layout.vector(parameters)
    torque = inverse_dynamics(robot, parameters, q, dq, ddq)
    np.testing.assert_allclose(torque, expected, rtol=1e-10, atol=1e-9)


def test_transmission_coupling_acts_as_in_the_regressor():
    robot = random_robot(5, *TREES["serial"])
    layout = parameter_layout(
        robot.joint_types,
        friction=("viscous", "coulomb", "offset"),
        drive_inertia=True,
        couplings=[(4, 5)],
    )
    values = np.random.default_rng(1).normal(size=len(layout.parameters))
    q, dq, ddq = states(robot)
    expected = StandardRegressor(robot, layout)(q, dq, ddq) @ values
    torque = inverse_dynamics(robot, layout.dynamic_parameters(values), q, dq, ddq)
    np.testing.assert_allclose(torque, expected, rtol=1e-10, atol=1e-9)
