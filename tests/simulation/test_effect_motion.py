"""Motion under effects against closed forms, scipy and pinocchio."""

import dataclasses

import numpy as np
import pinocchio as pin
import pytest
from scipy.integrate import solve_ivp

from bags.simulated_arms import arm2
from idim_iv_ros.errors import UsageError
from idim_iv_ros.model import build_inverse_model
from idim_iv_ros.simulation import SimulatedEffect, simulate_closed_loop
from tests.simulation.laws import commanded, driven, followed, pd
from tests.simulation.trees import random_robot


def disc(inertia=2.0, *, drive=0.0, coulomb=0.0, viscous=0.0, joints=1):
    """Discs on one fixed axis without gravity, side by side."""
    robot = random_robot(0, [0] * joints, [False] * joints)
    robot.pinocchio.gravity.linear = np.zeros(3)
    inertial = np.zeros((joints, 10))
    inertial[:, [4, 6, 9]] = inertia - drive
    parameters = dataclasses.replace(
        robot.given,
        inertial=inertial,
        drive_inertia=np.full(joints, float(drive)),
        coulomb=np.full(joints, float(coulomb)),
        viscous=np.full(joints, float(viscous)),
    )
    return robot, parameters


def on(robot, effect, other=None, joint=0, **parameters):
    other = None if other is None else robot.joints[other]
    return SimulatedEffect(effect, robot.joints[joint], parameters, other)


@pytest.mark.parametrize(
    "effect",
    [
        {"effect": "stribeck", "excess": 1.0, "speed": 0.01},
        {"effect": "friction_drift", "time_constant": 1e9, "coulomb": 1.0},
        {"effect": "position_dependent_friction", "height": 1.0, "width": 1.0},
    ],
)
def test_a_resting_joint_breaks_away_at_the_raised_level_only(effect):
    robot, parameters = disc(coulomb=2.0)
    raised = on(robot, **effect)
    push = np.linspace(0.0, 2.999, 2000)
    assert np.all(driven(robot, parameters, push, raised).position == 0.0)
    assert np.all(driven(robot, parameters, -push, raised).position == 0.0)
    moved = driven(robot, parameters, np.linspace(2.0, 3.05, 2000), raised)
    first = np.flatnonzero(moved.velocity)[0]
    assert moved.torque[first - 1, 0] == pytest.approx(3.0, abs=2e-3)


def test_stick_slip_is_that_of_an_integration_with_events():
    """A spring pulled slowly drags a block over Stribeck friction: it sticks and slips."""
    robot, parameters = disc(1.0, coulomb=1.0)
    stiffness, pull, excess, vs = 50.0, 0.2, 0.6, 0.05

    def level(v):
        return 1.0 + excess * np.exp(-((abs(v) / vs) ** 2))

    reached, time, q = [], 0.0, 0.0
    while True:
        time = max(time, (level(0.0) / stiffness + q) / pull)  # when the spring breaks it away
        if time >= 4.0:
            break

        def slide(t, y):
            return [y[1], stiffness * (pull * t - y[0]) - level(y[1])]

        def stopped(t, y):
            return y[1] - 1e-10 if t > time + 1e-3 else 1.0  # noqa: B023

        stopped.terminal, stopped.direction = True, -1.0
        slid = solve_ivp(
            slide, (time, 8.0), [q, 1e-8], events=stopped, rtol=1e-10, atol=1e-12, max_step=1e-3
        )
        time, q = slid.t[-1], slid.y[0, -1]
        reached.append(q)
    reference = pull * np.arange(4001)[:, None] / 1000.0
    result = driven(
        robot, parameters, np.zeros((4001, 1)),
        on(robot, "stribeck", excess=excess, speed=vs),
        law=pd([stiffness], [0.0], period=2.5e-4), position_reference=reference,
    )  # fmt: skip
    stuck = np.flatnonzero((result.velocity[1:, 0] == 0.0) & (result.velocity[:-1, 0] > 0.0))
    assert len(stuck) >= 3
    rests = result.position[stuck + 1, 0]
    np.testing.assert_allclose(rests, reached[: len(rests)], atol=2e-3)


def test_bristles_are_springs_until_they_slide():
    """Below the level the joint swings about its bent bristle; above, friction is Coulomb's."""
    robot, parameters = disc(2.0, coulomb=1.0)
    bristle = on(robot, "presliding", span_1=1e-3, level_1=1.0)
    result = driven(robot, parameters, np.full(200, 0.3), bristle)
    time = np.arange(200) / 1000.0
    pulsation = np.sqrt(1.0 / 1e-3 / 2.0)
    expected = 0.3e-3 * (1.0 - np.cos(pulsation * time))
    np.testing.assert_allclose(result.position[:, 0], expected, atol=2e-6)
    slid = driven(robot, parameters, np.full(1001, 3.0), bristle)
    work = 3.0 * slid.position[-1, 0] - 1.0 * (slid.position[-1, 0] - 0.5e-3)
    assert 0.5 * 2.0 * slid.velocity[-1, 0] ** 2 == pytest.approx(work, rel=1e-4)


def test_load_friction_holds_what_it_can_and_lets_go_of_the_rest():
    """A pendulum under gravity: friction of 0.5 of the load and none besides."""
    robot, parameters = disc(2.0)
    robot.pinocchio.jointPlacements[1] = pin.SE3.Identity()
    robot.pinocchio.gravity.linear = np.array([-9.81, 0.0, 0.0])
    inertial = parameters.inertial.copy()
    inertial[0, :4] = [1.0, 0.2, 0.3, 0.1]
    parameters = dataclasses.replace(parameters, inertial=inertial)
    load = -2.0 * driven(robot, parameters, np.zeros(2)).acceleration[0, 0]
    assert abs(load) > 0.5
    friction = on(robot, "load_dependent_friction", driving=0.5, driven=0.2)
    for share, moves in ((0.81, False), (1.0, False), (1.49, False), (1.6, True), (0.7, True)):
        result = driven(robot, parameters, np.full(100, share * load), friction)
        assert bool(np.any(result.position[-1] != result.position[10])) is moves, share


def test_stiff_shaft_is_stable_and_is_the_rigid_joint_in_the_limit():
    robot, parameters = disc(2.0, drive=0.4, coulomb=0.5)
    push = 5.0 * np.sin(np.arange(500) / 50.0)
    rigid = driven(robot, parameters, push)
    for stiffness, damping in ((1e7, 100.0), (1e12, 0.0)):
        shaft = on(robot, "elasticity", stiffness=stiffness, damping=damping)
        stiff = driven(robot, parameters, push, shaft)
        assert stiff.diverged is None
        np.testing.assert_allclose(stiff.position, rigid.position, atol=1e-5)


def test_elastic_arm_moves_as_with_pinocchio():
    """Both joints elastic, under gravity: links by pinocchio's ABA, motors by hand."""
    arm = arm2(seconds=1.0)
    robot, zero = arm.robot, np.zeros(2)
    parameters = dataclasses.replace(
        robot.given, viscous=np.array([1.0, 0.5]), coulomb=zero, offset=zero
    )
    stiffness, damping = np.array([900.0, 300.0]), np.array([1.0, 0.4])
    drive, kp, kd, goal = np.array([0.25, 0.1]), np.array([200.0, 60.0]), 10.0, np.array([0.5, 0.2])
    start = np.array([0.3, 0.5])
    model, data = robot.pinocchio, robot.pinocchio.createData()
    link = start.copy()
    for _ in range(100):
        link = start - pin.computeGeneralizedGravity(model, data, link) / stiffness

    def motion(t, y):
        q, x, dq, dx = y.reshape(4, 2)
        shaft = stiffness * (q - x) + damping * (dq - dx)
        command = np.array([200.0, 60.0]) * (goal - q) - kd * dq
        ddq = (command - np.array([1.0, 0.5]) * dq - shaft) / drive
        return np.concatenate([dq, dx, ddq, pin.aba(model, data, x, dx, shaft)])

    y0 = np.concatenate([start, link, zero, zero])
    exact = solve_ivp(motion, (0.0, 1.0), y0, rtol=1e-10, atol=1e-12).y[:, -1].reshape(4, 2)
    effects = [
        on(robot, "elasticity", joint=j, stiffness=stiffness[j], damping=damping[j]) for j in (0, 1)
    ]
    result = simulate_closed_loop(
        robot, parameters, pd(kp, [kd, kd], period=1e-4), rate=1000.0,
        position_reference=np.tile(goal, (1001, 1)), velocity_reference=np.zeros((1001, 2)),
        initial_position=start, initial_velocity=zero, effects=effects,
    )  # fmt: skip
    np.testing.assert_allclose(result.link_position[0], link, atol=1e-9)
    np.testing.assert_allclose(result.position[-1], exact[0], atol=5e-4)
    np.testing.assert_allclose(result.link_position[-1], exact[1], atol=5e-4)
    assert np.abs(result.position - result.link_position).max() > 5e-3


def test_grouped_drive_inertia_is_split_as_the_given_model_says():
    """Base parameters hold YY1 + Ia1; the shaft of joint 1 needs Ia1 alone."""
    arm = arm2(seconds=1.0)
    urdf = arm.configuration.robot.urdf
    model = build_inverse_model(arm.configuration, urdf.read_text(), urdf.name)
    grouped = model.dynamic_parameters(model.given)
    assert grouped.drive_inertia[0] == 0.0
    elastic = [
        SimulatedEffect("elasticity", "joint_1", {"stiffness": 2000.0, "damping": 2.0}),
        SimulatedEffect("backlash", "joint_2", {"gap": 1e-3}),
    ]

    def run(robot, parameters):
        return followed(arm, *elastic, robot=robot, parameters=parameters)

    np.testing.assert_allclose(
        run(arm.robot, grouped).position, run(arm.robot, arm.robot.given).position, atol=1e-5
    )
    unknown = dataclasses.replace(
        arm.robot, given=dataclasses.replace(arm.robot.given, drive_inertia=np.zeros(2))
    )
    with pytest.raises(UsageError, match=r"joint_1 needs its drive inertia.*simulator.armature"):
        run(unknown, grouped)
    negative = dataclasses.replace(grouped, drive_inertia=np.array([-0.1, 0.1]))
    with pytest.raises(UsageError, match="positive drive inertia"):
        run(arm.robot, negative)


def test_backlash_moves_the_motor_alone_until_the_gap_is_closed():
    robot, parameters = disc(2.0, drive=0.4)
    result = driven(
        robot, parameters, np.full(1000, 1.0), on(robot, "backlash", gap=0.02, damping=0.0)
    )
    time = np.arange(1000) / 1000.0
    free = time < np.sqrt(2.0 * 0.01 * 0.4)
    np.testing.assert_allclose(result.position[free, 0], 0.5 * time[free] ** 2 / 0.4, atol=1e-9)
    assert np.all(result.link_position[free] == 0.0)
    # Elastic flanks lose nothing; momentum is that of the push, whatever bounces.
    momentum = 0.4 * result.velocity[:, 0] + 1.6 * result.link_velocity[:, 0]
    np.testing.assert_allclose(momentum, time, atol=1e-9)
    assert 0.01 < np.abs(result.position - result.link_position).max() < 0.0105


def test_the_motor_gives_what_gain_and_saturation_leave_of_the_command():
    robot, parameters = disc(1.0)
    push = np.linspace(-8.0, 8.0, 401)
    bent = [
        on(robot, "torque_saturation", knee=4.0, slope=0.25),
        on(robot, "torque_gain", factor=0.9),
    ]
    result = driven(robot, parameters, push, *bent)
    np.testing.assert_array_equal(result.torque[:, 0], push)
    size = np.where(np.abs(push) > 4.0, 4.0 + 0.25 * (np.abs(push) - 4.0), np.abs(push))
    acting = 0.9 * np.sign(push) * size
    np.testing.assert_allclose(np.diff(result.velocity[:, 0]), 1e-3 * acting[:-1], atol=1e-12)


def test_encoder_error_is_what_the_control_sees():
    arm = arm2(seconds=2.0)
    bent = {"sine": 2e-3, "cosine": -1e-3, "sine_2": 5e-4, "cosine_2": 3e-4}
    result = followed(arm, SimulatedEffect("encoder_eccentricity", "joint_1", bent))
    q = result.position[:, 0]
    shown = q + 2e-3 * np.sin(q) - 1e-3 * np.cos(q) + 5e-4 * np.sin(2 * q) + 3e-4 * np.cos(2 * q)
    np.testing.assert_allclose(result.measured_position[:, 0], shown, atol=1e-14)
    np.testing.assert_allclose(result.measured_position[0], arm.position_reference[0], atol=1e-14)
    np.testing.assert_array_equal(result.measured_position[:, 1], result.position[:, 1])
    rate = np.gradient(shown, 1.0 / arm.rate)[1:-1]
    np.testing.assert_allclose(result.measured_velocity[1:-1, 0], rate, atol=5e-3)
    np.testing.assert_allclose(result.torque, commanded(arm, result), atol=1e-9)


def test_the_robots_own_gains_and_feedforward_replace_those_configured():
    arm = arm2(seconds=2.0)
    gains = {"kp": 900.0, "feedforward_acceleration": 0.5, "feedforward_velocity": 1.5}
    result = followed(arm, SimulatedEffect("controller_mismatch", "joint_1", gains))
    command = commanded(arm, result, kp=np.array([900.0, arm.law.kp[1]]))
    speed = arm.velocity_reference[:, 0]
    command[:, 0] += 1.5 * speed + 0.5 * np.gradient(speed, 1.0 / arm.rate)
    np.testing.assert_allclose(result.torque, command, atol=1e-9)


def test_the_command_lags_behind_the_law_as_through_a_first_order_filter():
    arm = arm2(seconds=2.0)
    result = followed(arm, SimulatedEffect("controller_mismatch", "joint_2", {"lag": 4e-3}))
    law = commanded(arm, result)
    kept = np.exp(-1e-3 / 4e-3)
    expected = law.copy()
    for k in range(1, len(law)):
        expected[k, 1] = kept * expected[k - 1, 1] + (1.0 - kept) * law[k, 1]
    np.testing.assert_allclose(result.torque, expected, atol=1e-9)
    assert np.abs(expected - law).max() > 0.1
