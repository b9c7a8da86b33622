"""Dry friction as solvers soften it: against MuJoCo's own, and where it is and is not found."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from bags.simulated_arms import SimulatedArm
from idim_iv_ros.diagnosis.refit.baseline import Baseline, smooth_regression
from idim_iv_ros.diagnosis.refit.refit import refitted
from idim_iv_ros.diagnosis.refit.soft_friction import SoftFriction, _crossing, soft_friction
from tests.estimation.test_simulated_arms import recorded

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
    speed, slope, friction = [], [], []
    for step in range(20000):
        state.qfrc_applied[0] = 4.0 * np.sin(2.0 * np.pi * 0.7 * step * 2e-4)
        before = float(state.qvel[0])
        mujoco.mj_step(model, state)
        speed.append(before)
        slope.append(float(state.qacc[0]))
        friction.append(-float(state.qfrc_constraint[0]) / 1.5)
    v, a = (np.array(values)[:, None, None] for values in (speed, slope))
    soft = (1.0 - 0.9) / 0.9
    computed = _crossing(v, a, 0, LEAD, LEAD * soft * 1.5 / inertia)
    turning = np.abs(np.array(speed)) < 0.05
    assert np.sum(np.abs(friction)[turning] < 0.9) > 200
    assert np.max(np.abs(computed - friction)) < 0.05
    ideal = np.sign(speed)
    assert np.mean((computed - friction)[turning] ** 2) < 1e-3 * np.mean(
        (ideal - friction)[turning] ** 2
    )


def test_friction_that_sticks_is_not_taken_for_soft(arm: SimulatedArm, data: Baseline) -> None:
    assert soft_friction(data, smooth_regression(data)) is None
    assert refitted([recorded(arm, 1)], arm.configuration, ()).softened is None


@pytest.mark.parametrize("softer", [(0, 1), (1,)])
def test_a_lead_at_most_joints_is_found(data: Baseline, softer: tuple[int, ...]) -> None:
    """Of one joint in two it may be the joint's own: friction that the model lacks."""
    leads = np.array([LEAD if joint in softer else np.nan for joint in (0, 1)])
    changed = SoftFriction(leads, np.array([2e-3, 5e-3])).put_into(data)
    (new,), (old,), rows = changed.motions, data.motions, []
    for joint, row in enumerate(data.rows):
        extra = new.rows(old.whole.coulomb[joint] * (new.slip - old.slip)[:, [joint]])
        rows.append(replace(row, torque=row.torque + data.counting(joint, [extra[:, 0]])))
    robot = replace(data, rows=tuple(rows))
    friction = soft_friction(robot, smooth_regression(robot))
    if len(softer) == 1:
        assert friction is None
        return
    assert friction is not None
    np.testing.assert_allclose(friction.leads, LEAD, atol=1.6e-3)
    assert "joint_1, joint_2" in friction.sentence(data.joints)
