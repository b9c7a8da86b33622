"""Errors of signals and mounting: what they make, against inverse dynamics."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from bags.simulated_arms import SimulatedArm, arm2, arm6
from idim_iv_ros.diagnosis.comparison.curves import CommonShift, TiltedMoments
from idim_iv_ros.diagnosis.refit import turning_friction as friction
from idim_iv_ros.diagnosis.refit.baseline import Baseline
from idim_iv_ros.diagnosis.refit.refit import refitted
from idim_iv_ros.diagnosis.refit.smooth_motion import SmoothMotion
from idim_iv_ros.effects.effect import Place, Shape
from idim_iv_ros.simulation import inverse_dynamics
from tests.diagnosis.motions import smooth_motion, synthetic
from tests.estimation.test_simulated_arms import recorded

RATE = 200.0


def moving(arm: SimulatedArm, seconds: float = 5.0) -> SmoothMotion:
    """All joints on a sine of their own."""
    time = np.arange(round(seconds * RATE)) / RATE
    pulsation = np.linspace(1.3, 4.1, len(arm.robot.joints))
    angle = time[:, None] * pulsation
    return smooth_motion(
        arm,
        0.2 + 0.6 * np.sin(angle),
        0.6 * pulsation * np.cos(angle),
        -0.6 * pulsation**2 * np.sin(angle),
        RATE,
    )


def test_moments_that_gravity_does_not_show_turn_with_the_first_joint_under_a_tilt() -> None:
    """Of arm6, whose first axis is vertical: a link 1 whose mass lies elsewhere."""
    motion = moving(arm6(seconds=1.0))
    other = motion.links.inertial.copy()
    other[0, 1:3] += [0.4, -0.7]  # first moments about the vertical axis, kg m
    moved = replace(motion.links, inertial=other)
    tilted = motion.robot.pinocchio.copy()
    tilted.gravity.linear = np.array([0.3, -0.5, -9.78])
    states = motion.position, np.zeros_like(motion.position), np.zeros_like(motion.position)
    torques = [
        inverse_dynamics(replace(motion.robot, pinocchio=model), links, *states)
        for model in (motion.robot.pinocchio, tilted)
        for links in (motion.links, moved)
    ]
    level, slanting = torques[1] - torques[0], torques[3] - torques[2]
    np.testing.assert_allclose(level, 0.0, atol=1e-9)
    assert np.ptp(slanting[:, 0]) > 0.1
    np.testing.assert_allclose(slanting[:, 1:], 0.0, atol=1e-9)
    (columns,) = TiltedMoments().columns(motion, Place(0), Shape()).values()
    solution = np.linalg.lstsq(columns, slanting[:, 0], rcond=None)[0]
    np.testing.assert_allclose(columns @ solution, slanting[:, 0], atol=1e-9)


def test_where_gravity_shows_them_they_are_base_parameters() -> None:
    """The first axis of arm2 is level."""
    (columns,) = TiltedMoments().columns(moving(arm2(seconds=1.0)), Place(0), Shape()).values()
    assert not columns.any()


def test_a_shift_of_all_efforts_is_the_rate_of_their_torques() -> None:
    """τ(t + s) − τ(t) = s dτ/dt at every joint, one coefficient; of one joint it is a delay."""
    motion = synthetic()
    columns = CommonShift().columns(motion, Place(0), Shape())
    assert set(columns) == {0, 1}
    smooth = replace(motion, slip=np.zeros_like(motion.slip))
    shift = 1e-3
    for joint, rate in CommonShift().columns(smooth, Place(0), Shape()).items():
        later = np.interp(smooth.time + shift, smooth.time, smooth.torque[:, joint])
        inner = slice(5, -5)
        error = later[inner] - smooth.torque[inner, joint] - shift * rate[inner, 0]
        assert np.abs(error).max() < 0.05 * np.abs(shift * rate).max()
    assert CommonShift().places(1) == []


LEAD = 0.95 * 0.02 / 2.0  # d T_ref / 2 of MuJoCo's defaults, s

HINGE = """
<mujoco>
  <option timestep="0.0002" integrator="implicitfast" gravity="0 0 0"/>
  <worldbody>
    <body>
      <joint name="hinge" type="hinge" axis="0 0 1" frictionloss="1.5"/>
      <geom type="box" size="0.5 0.1 0.1" mass="10" contype="0" conaffinity="0"/>
    </body>
  </worldbody>
</mujoco>
"""


def test_mujoco_turns_its_friction_before_the_joint() -> None:
    """Friction of a hinge pushed to and fro, as its solver computed it, N m."""
    model = mujoco.MjModel.from_xml_string(HINGE)
    state = mujoco.MjData(model)
    inertia = 10.0 / 3.0 * (0.5**2 + 0.1**2)
    speed, slope, solved = [], [], []
    for step in range(20000):
        state.qfrc_applied[0] = 4.0 * np.sin(2.0 * np.pi * 0.7 * step * 2e-4)
        before = float(state.qvel[0])
        mujoco.mj_step(model, state)
        speed.append(before)
        slope.append(float(state.qacc[0]))
        solved.append(-float(state.qfrc_constraint[0]) / 1.5)
    v, a = (np.array(values)[None, None] for values in (speed, slope))
    soft = (1.0 - 0.9) / 0.9
    computed = friction.TurningFriction({0: LEAD}, {0: LEAD * soft * 1.5 / inertia}).slip(0, v, a)
    turning = np.abs(np.array(speed)) < 0.05
    assert np.sum(np.abs(solved)[turning] < 0.9) > 200
    assert np.max(np.abs(computed - solved)) < 0.05
    errors = [np.mean((model - solved)[turning] ** 2) for model in (computed, np.sign(speed))]
    assert errors[0] < 1e-3 * errors[1]


def test_friction_of_a_joint_that_rests_crosses_evenly() -> None:
    """1 kg with 50 N of dry friction follows a slow sine by a spring and a damper: it sticks."""
    step, position, speed = 1e-3, 0.0, 0.0
    time = step * np.arange(8000)
    wanted, fast = 0.5 * np.sin(np.pi * time), 0.5 * np.pi * np.cos(np.pi * time)
    speeds, frictions = [], []
    for place, pace in zip(wanted.tolist(), fast.tolist(), strict=True):
        push = 900.0 * (place - position) + 60.0 * (pace - speed)
        frictions.append(float(np.clip(push + speed / step, -50.0, 50.0)) / 50.0)
        speed += step * (push - 50.0 * frictions[-1])
        position += step * speed
        speeds.append(speed)
    v = (np.array(speeds) + 1e-3 * np.random.default_rng(1).standard_normal(8000))[None, None]
    computed = friction.TurningFriction({0: 0.0}, {0: 0.02}, True).slip(0, v, v)
    sharp = friction.TurningFriction({0: 0.0}, {0: 1e-9}).slip(0, v, np.zeros_like(v))
    after = slice(1000, 7000)  # a first and a last reversal have no other side
    errors = [np.mean((model - frictions)[after] ** 2) for model in (computed, sharp)]
    assert np.mean(np.abs(speeds)[after] < 1e-9) > 0.02
    assert errors[0] < 0.05 * errors[1]


def test_friction_that_sticks_is_not_taken_for_soft(arm: SimulatedArm, data: Baseline) -> None:
    assert friction.turning_friction(data).leads == {}
    assert refitted([recorded(arm, 1)], arm.configuration, ()).turning.leads == {}


def test_friction_that_turns_when_it_was_measured_to_is_no_solvers(data: Baseline) -> None:
    """A simulated loop that turns its joints at other times than the robot did."""
    late = tuple(replace(m, slip=np.roll(m.slip, 4, axis=0)) for m in data.motions)
    turning = friction.turning_friction(data.on(late))
    assert set(turning.leads.values()) == {0.0}
    assert (turning.soft_leads(data.joints), turning.sentence(data.joints)) == ({}, "")


@pytest.mark.parametrize("softer", [(0, 1), (1,)])
def test_a_lead_at_most_joints_is_found(data: Baseline, softer: tuple[int, ...]) -> None:
    """Of one joint in two it may be the joint's own: friction that the model lacks."""
    leads = dict.fromkeys(softer, LEAD)
    changed = friction.TurningFriction(leads, {0: 2e-3, 1: 5e-3}).put_into(data)
    (new,), (old,), rows = changed.motions, data.motions, []
    for joint, row in enumerate(data.rows):
        extra = new.rows(old.whole.coulomb[joint] * (new.slip - old.slip)[:, [joint]])
        rows.append(replace(row, torque=row.torque + data.counting(joint, [extra[:, 0]])))
    robot = replace(data, regression=replace(data.regression, joints=tuple(rows)))
    turning = friction.turning_friction(robot)
    if len(softer) == 1:
        assert turning.leads == {}
        return
    np.testing.assert_allclose(list(turning.leads.values()), LEAD, atol=1.6e-3)
    assert "joint_1, joint_2" in turning.sentence(data.joints)
