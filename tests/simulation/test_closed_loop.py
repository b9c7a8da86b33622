"""The simulated loop: smooth motion, sampled control, delay, saturation, divergence."""

import dataclasses
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from scipy.integrate import solve_ivp

from bags.simulated_arms import arm6, arm7
from idim_iv_ros.configuration import ControllerSection
from idim_iv_ros.simulation import control_law, inverse_dynamics, mass_matrix
from tests.simulation.laws import commanded, driven, followed, pd
from tests.simulation.trees import TREES, random_robot

CONFIG = Path(__file__).parents[2] / "config"


def free_fall(robot, parameters, q, dq, step):
    start = {"initial_position": q, "initial_velocity": dq}
    result = driven(robot, parameters, np.zeros(2), rate=1.0, plant_step=step, **start)
    return np.concatenate([result.position[-1], result.velocity[-1]])


@pytest.mark.parametrize("tree", ["serial", "prismatic", "branched"])
def test_smooth_motion_converges_to_that_of_pinocchio_with_second_order(tree):
    robot = random_robot(3, *TREES[tree])
    n, order = len(robot.joints), robot.order
    parameters = dataclasses.replace(
        robot.given, viscous=np.full(n, 0.3), drive_inertia=np.full(n, 0.1)
    )
    model, data = robot.pinocchio, robot.pinocchio.createData()
    model.armature = np.full(n, 0.1)

    def motion(_, y):
        tree_dq = y[n:][order]
        ddq = np.empty(n)
        ddq[order] = pin.aba(model, data, y[:n][order], tree_dq, -0.3 * tree_dq)
        return np.concatenate([y[n:], ddq])

    q, dq = np.random.default_rng(0).normal(size=(2, n))
    exact = solve_ivp(
        motion, (0.0, 1.0), np.concatenate([q, dq]), method="DOP853", rtol=1e-10, atol=1e-12
    ).y[:, -1]
    errors = [
        np.abs(free_fall(robot, parameters, q, dq, step) - exact).max()
        for step in (1e-3, 5e-4, 2.5e-4)
    ]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert np.all(np.abs(orders - 2.0) < 0.05)
    assert errors[-1] < 1e-3


def test_arm_falls_as_in_mujoco():
    mujoco = pytest.importorskip("mujoco")
    arm = arm6(seconds=1.0)
    model = mujoco.MjModel.from_xml_path(str(CONFIG / "arm6.urdf"))
    model.opt.timestep, model.opt.integrator = 1e-4, mujoco.mjtIntegrator.mjINT_RK4
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_LIMIT
    model.dof_frictionloss[:] = 0.0
    model.dof_damping[:] = arm.robot.given.viscous
    model.dof_armature[:] = arm.robot.given.drive_inertia
    data = mujoco.MjData(model)
    data.qpos[:] = q = np.array([0.3, 0.5, -0.8, 0.4, 0.7, -0.2])
    data.qvel[:] = dq = np.array([1.0, -0.5, 0.8, 2.0, -1.0, 1.5])
    for _ in range(10_000):
        mujoco.mj_step(model, data)
    parameters = dataclasses.replace(arm.robot.given, coulomb=np.zeros(6))
    expected = np.concatenate([data.qpos, data.qvel])
    np.testing.assert_allclose(free_fall(arm.robot, parameters, q, dq, 1e-4), expected, atol=1e-5)


@pytest.fixture(scope="module")
def arm():
    return arm7(seconds=3.0)


def test_a_disturbance_acts_on_the_joints_and_is_not_commanded(arm):
    disturbance = np.random.default_rng(5).normal(size=arm.position_reference.shape) * 2.0
    result = followed(arm, disturbance=disturbance)
    needed = inverse_dynamics(
        arm.robot, arm.truth, result.position, result.velocity, result.acceleration
    )
    moving = np.all(result.velocity != 0.0, axis=1)
    assert moving.sum() > 1000
    np.testing.assert_allclose(needed[moving], result.applied_torque[moving], atol=1e-9)
    # Held from its sample on: at the sample itself the mean of both sides acts.
    before = np.vstack([disturbance[:1], disturbance[:-1]])
    command = np.vstack([result.torque[:1], result.torque[:-1]])
    expected = 0.5 * (command + before + result.torque + disturbance)
    np.testing.assert_allclose(result.applied_torque, expected, atol=1e-9)


def test_torque_is_the_law_evaluated_at_the_sample(arm):
    result = followed(arm)
    expected = commanded(arm, result)
    np.testing.assert_allclose(result.torque, expected, atol=1e-9)
    mean = 0.5 * (expected[1:] + expected[:-1])
    np.testing.assert_allclose(result.applied_torque[1:], mean, atol=1e-9)


def test_cascade_is_a_pd_law_without_velocity_reference(arm):
    law = dataclasses.replace(arm.law, velocity_reference=False)
    cascade = control_law(
        ControllerSection(
            type="cascade",
            kp=list(law.kp / law.kd),
            kv=list(law.kd / 2.5),
            drive_gain=[2.5] * 7,
            torque_limit=list(law.torque_limit),
            period=law.period,
            delay=law.delay,
        ),
        7,
    )
    np.testing.assert_allclose(
        followed(arm, law=law).position, followed(arm, law=cascade).position, atol=1e-12
    )


def test_scaled_gains_keep_the_bandwidth_of_a_heavier_robot(arm):
    light = dataclasses.replace(
        arm.truth, **{
            name: getattr(arm.truth, name) * 0.25
            for name in ("inertial", "drive_inertia", "viscous", "coulomb", "offset")
        }
    )  # fmt: skip
    expected = followed(arm).position
    scaled = followed(arm, law=arm.law.scaled(np.full(7, 0.25)), parameters=light)
    np.testing.assert_allclose(scaled.position, expected, atol=1e-9)


def free_mass(coulomb=0.0):
    """One kilogram on a slide without gravity."""
    robot = random_robot(0, [0], [True])
    robot.pinocchio.gravity.linear = np.zeros(3)
    inertial = np.zeros((1, 10))
    inertial[0, 0] = 1.0
    return robot, dataclasses.replace(robot.given, inertial=inertial, coulomb=np.array([coulomb]))


@pytest.mark.parametrize("ratio", [0.3, 3.0])
def test_control_may_run_at_another_rate_than_the_recording(arm, ratio):
    law = dataclasses.replace(arm.law, period=ratio / arm.rate)
    result = followed(arm, law=law)
    assert result.diverged is None
    assert np.abs(result.position - followed(arm).position).max() < 2e-3


def test_saturated_torque_stays_at_its_limit_and_the_integral_does_not_wind_up():
    # Friction holds the block against all that the drive can do; then the reference returns.
    robot, parameters = free_mass(coulomb=10.0)
    reference = np.ones((4000, 1))
    reference[3000:] = 0.0
    law = pd([100.0], [20.0], ki=200.0, limit=2.0)
    references = {"position_reference": reference, "velocity_reference": np.zeros((4000, 1))}
    result = driven(robot, parameters, np.zeros(4000), law=law, **references)
    assert np.all(result.torque[:3000] == 2.0)
    assert np.all(result.torque[3000:] == 0.0)
    assert np.all(result.position == 0.0)


def test_a_loop_that_runs_away_says_which_joint_and_when(arm):
    law = dataclasses.replace(arm.law, kd=-arm.law.kd, torque_limit=np.full(7, np.inf))
    result = followed(arm, law=law)
    assert result.diverged.startswith("joint joint_") and "passed 1000 rad/s at " in result.diverged
    assert len(result.position) < len(arm.position_reference)
    for values in (result.position, result.velocity, result.acceleration, result.torque):
        assert np.all(np.isfinite(values))


def test_parameters_without_positive_inertia_end_the_simulation_with_that_reason(arm):
    inertial = arm.truth.inertial.copy()
    inertial[2:, 4:] *= -1.0
    parameters = dataclasses.replace(arm.truth, inertial=inertial, drive_inertia=np.zeros(7))
    mass = mass_matrix(arm.robot, parameters, arm.position_reference[:1])
    assert np.linalg.eigvalsh(mass[0])[0] < 0.0
    result = followed(
        arm, parameters=parameters, velocity_reference=None, initial_velocity=np.zeros(7)
    )
    assert result.diverged == "the mass matrix is not positive definite at 0.000 s"
