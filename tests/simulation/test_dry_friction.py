"""Dry friction holds what it can hold, exactly, and takes the energy that it should."""

import dataclasses

import numpy as np
import pinocchio as pin
import pytest
from scipy.integrate import solve_ivp

from idim_iv_ros.simulation import inverse_dynamics, simulate_closed_loop
from tests.simulation.laws import driven, torque
from tests.simulation.trees import TREES, random_robot

SLOPE = 9.81 * np.sin(0.4)


def block(friction):
    """2 kg on a slope of 0.4 rad, x up the slope."""
    robot = random_robot(0, [0], [True])
    robot.pinocchio.jointPlacements[1] = pin.SE3.Identity()
    robot.pinocchio.gravity.linear = -SLOPE * np.array([0.0, 1.0, 0.0])
    inertial = np.zeros((1, 10))
    inertial[0, 0] = 2.0
    return robot, dataclasses.replace(robot.given, inertial=inertial, coulomb=np.array([friction]))


def pendulum(friction, samples=2001):
    """1 kg at 0.5 m, swinging from 2 rad for 20 s."""
    robot = random_robot(0, [0], [False])
    robot.pinocchio.jointPlacements[1] = pin.SE3.Identity()
    robot.pinocchio.gravity.linear = np.array([0.0, 0.0, -9.81])
    inertial = np.array([[1.0, 0.0, 0.0, -0.5, 0.25, 0.0, 0.25, 0.0, 0.0, 0.25]])
    given = dataclasses.replace(robot.given, inertial=inertial, coulomb=np.array([friction]))
    return robot, given


def released(robot, parameters, *, position, velocity=0.0, seconds, rate=100.0, step=1e-3):
    n = len(robot.joints)
    start = {"initial_position": np.full(n, position), "initial_velocity": np.full(n, velocity)}
    torques = np.zeros(round(seconds * rate) + 1)
    return driven(robot, parameters, torques, rate=rate, plant_step=step, **start)


def test_block_stays_put_while_friction_can_hold_it():
    result = released(*block(2.0 * SLOPE * (1.0 + 1e-9)), position=0.3, seconds=20.0)
    assert np.all(result.position == 0.3)
    assert np.all(result.velocity == 0.0)


@pytest.mark.parametrize("friction", [3.0, 10.0])
def test_block_thrown_up_slides_back_only_if_the_slope_is_steep_enough(friction):
    result = released(*block(friction), position=0.0, velocity=3.0, seconds=2.0, rate=7.0)
    deceleration = SLOPE + friction / 2.0
    stop, height = 3.0 / deceleration, 4.5 / deceleration
    back = max(SLOPE - friction / 2.0, 0.0)
    time = np.arange(len(result.position)) / 7.0
    up = 3.0 * time - 0.5 * deceleration * time**2
    down = height - 0.5 * back * (time - stop) ** 2
    expected = np.where(time < stop, up, down)
    np.testing.assert_allclose(result.position[:, 0], expected, atol=1e-9)


def test_every_swing_of_a_pendulum_loses_friction_times_angle_until_it_hangs():
    friction = 0.3
    robot, parameters = pendulum(friction)
    result = released(robot, parameters, position=2.0, seconds=20.0, rate=1000.0, step=2e-4)
    q, dq = result.position[:, 0], result.velocity[:, 0]
    potential = -9.81 * 0.5 * np.cos(q)
    energy = 0.5 * 0.25 * dq**2 + potential
    travelled = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(q)))])
    np.testing.assert_allclose(energy[0] - energy, friction * travelled, atol=2e-4)
    at_rest = np.flatnonzero(dq != 0.0)[-1] + 1
    assert at_rest < len(q) - 1000
    assert np.all(q[at_rest:] == q[at_rest])
    assert abs(9.81 * 0.5 * np.sin(q[-1])) <= friction


def test_reversals_are_located_with_second_order_accuracy():
    robot, parameters = pendulum(0.3)
    errors = []
    time, q, dq, sign, reached = 0.0, 2.0, 0.0, -1.0, []
    while time < 3.0:

        def swing(t, y, sign=sign):
            return [y[1], (-9.81 * 0.5 * np.sin(y[0]) - 0.3 * sign) / 0.25]

        def turned(t, y):
            return y[1]

        turned.terminal, turned.direction = True, -sign
        start = [q, dq + 1e-13 * sign]
        swung = solve_ivp(swing, (time, 3.0), start, events=turned, rtol=1e-12, atol=1e-13)
        time, q, dq, sign = swung.t[-1], swung.y[0, -1], swung.y[1, -1], -sign
        reached = swung.y[:, -1]
    for step in (4e-3, 2e-3, 1e-3, 5e-4):
        result = released(robot, parameters, position=2.0, seconds=3.0, rate=1.0, step=step)
        errors.append(abs(result.position[-1, 0] - reached[0]))
    assert errors[-1] < 1e-5
    assert np.log2(errors[0] / errors[-1]) / 3.0 > 1.7


def excited(robot, parameters, seed=0, seconds=4.0, amplitude=20.0):
    """Slow pushes that stop and start the joints, with some damping against running away."""
    rng = np.random.default_rng(seed)
    n, rate = len(robot.joints), 500.0
    time = np.arange(round(seconds * rate))[:, None] / rate
    wave = sum(
        rng.normal(size=n) * np.sin(2.0 * np.pi * rng.uniform(0.1, 2.0, n) * time + k)
        for k in range(4)
    )
    result = simulate_closed_loop(
        robot,
        parameters,
        torque(amplitude * wave),
        rate=rate,
        position_reference=np.zeros_like(wave),
        initial_position=np.zeros(n),
        initial_velocity=np.zeros(n),
        plant_step=1e-3,
    )
    frictionless = dataclasses.replace(
        parameters, coulomb=np.zeros(n), coupling_coulomb=np.zeros_like(parameters.coupling_coulomb)
    )
    needed = inverse_dynamics(
        robot, frictionless, result.position, result.velocity, result.acceleration
    )
    return result, result.applied_torque - needed


def heavy(robot, friction, **couplings):
    n = len(robot.joints)
    return dataclasses.replace(
        robot.given,
        drive_inertia=np.full(n, 0.5),
        viscous=np.full(n, 8.0),
        coulomb=np.asarray(friction, dtype=float),
        **couplings,
    )


def test_friction_of_stuck_and_moving_joints_obeys_coulomb_at_every_sample():
    robot = random_robot(4, *TREES["serial"])
    robot.pinocchio.gravity.linear = np.array([0.0, 0.0, -2.0])
    level = np.array([15.0, 12.0, 10.0, 12.0, 6.0, 9.0])
    result, friction = excited(robot, heavy(robot, level))
    assert result.diverged is None
    moving = result.velocity != 0.0
    expected = np.broadcast_to(level, friction.shape) * np.sign(result.velocity)
    np.testing.assert_allclose(friction[moving], expected[moving], atol=1e-9)
    assert np.all(np.abs(friction) <= level * (1.0 + 1e-9))
    stuck = np.sum(~moving, axis=1)
    assert set(stuck) >= {0, 1, 2, 3}
    changes = np.sum(np.diff(moving.astype(int), axis=0) != 0)
    assert changes < 200


def test_a_stuck_transmission_coupling_moves_two_joints_against_each_other():
    robot = random_robot(4, *TREES["serial"])
    robot.pinocchio.gravity.linear = np.zeros(3)
    a, b, level, coupled = 4, 5, np.array([4.0, 4.0, 4.0, 4.0, 3.0, 3.0]), 8.0
    parameters = heavy(
        robot,
        level,
        coupling_joints=np.array([[a, b]]),
        coupling_inertia=np.array([0.1]),
        coupling_viscous=np.array([1.0]),
        coupling_coulomb=np.array([coupled]),
    )
    result, friction = excited(robot, parameters, seed=3)
    dq = result.velocity
    slip = dq[:, a] + dq[:, b]
    both = (dq[:, a] != 0.0) & (dq[:, b] != 0.0)
    sticking, slipping = both & (slip == 0.0), both & (slip != 0.0)
    assert sticking.sum() > 20 and slipping.sum() > 100
    share = friction - level * np.sign(dq)
    np.testing.assert_allclose(share[slipping, a], coupled * np.sign(slip[slipping]), atol=1e-9)
    np.testing.assert_allclose(share[slipping, b], coupled * np.sign(slip[slipping]), atol=1e-9)
    np.testing.assert_allclose(share[sticking, a], share[sticking, b], atol=1e-8)
    assert np.all(np.abs(share[sticking, a]) <= coupled * (1.0 + 1e-9))
    stuck = (dq[:, a] == 0.0) & (dq[:, b] == 0.0)
    low = np.maximum(friction[stuck, a] - level[a], friction[stuck, b] - level[b])
    high = np.minimum(friction[stuck, a] + level[a], friction[stuck, b] + level[b])
    assert stuck.sum() > 10
    assert np.all(low <= high + 1e-9) and np.all(np.maximum(low, -high) <= coupled + 1e-9)
