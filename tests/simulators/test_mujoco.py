"""Effects in MuJoCo: against formulas written elsewhere, and against the project's own simulator.

The two simulators share the laws of the effects. Rigid bodies, dry friction, time steps and the
closed loop are MuJoCo's here.
"""

import json
from pathlib import Path

import mujoco
import numpy as np
import pytest

from bags.simulated_arms import arm2
from idim_iv_ros.errors import UsageError
from idim_iv_ros.simulation import SimulatedEffect
from idim_iv_ros.simulators.mujoco import (
    STIFFEST,
    Effects,
    add_motors,
    add_parts,
    model_with_effects,
    plant_spec,
    set_inertias,
)
from idim_iv_ros.simulators.mujoco_loop import LONGEST_STEP, References, run_in_mujoco
from tests.simulation.laws import followed
from tests.simulation.test_effects import FORMULAS

JOINTS = ("joint_1", "joint_2")
PENDULUM = """<mujoco>
  <option timestep="0.00001" integrator="implicitfast"/>
  <worldbody><body name="link"><inertial mass="2" pos="0.3 0 0" diaginertia="0.02 0.03 0.04"/>
    <joint name="joint_1" axis="0 1 0" armature="0.2" damping="0.4" frictionloss="1.5"/>
    <body pos="0.5 0 0"><inertial mass="1" pos="0.2 0 0" diaginertia="0.01 0.01 0.01"/>
      <joint name="joint_2" axis="0 1 0" armature="0.1" damping="0.1" frictionloss="0.8"/></body>
  </body></worldbody>
  <actuator><motor joint="joint_1"/><motor joint="joint_2"/></actuator>
</mujoco>"""


def on(effect: str, joint: int = 0, other: int | None = None, **numbers: float) -> SimulatedEffect:
    return SimulatedEffect(effect, JOINTS[joint], numbers, None if other is None else JOINTS[other])


def pendulum(*effects: SimulatedEffect) -> mujoco.MjModel:
    spec = mujoco.MjSpec.from_string(PENDULUM)
    add_parts(spec, effects)
    return spec.compile()


def opposing(model: mujoco.MjModel, effects: Effects, q: float, dq: float) -> float:
    """Torque beyond the rigid body that joint 1 needs at this state: friction and effects."""
    data = mujoco.MjData(model)
    data.qpos[0], data.qvel[0] = q, dq
    mujoco.mj_forward(model, data)
    effects.reset()
    effects.apply(model, data)
    mujoco.mj_forward(model, data)
    return -float((data.qfrc_applied + data.qfrc_passive + data.qfrc_constraint)[0])


@pytest.mark.parametrize("name", FORMULAS)
def test_the_torque_of_an_effect_is_that_of_its_formula(name: str) -> None:
    numbers, formula = FORMULAS[name]
    effect = on("nonlinear_viscous" if "drag" in name else name.split()[0], **numbers)
    random = np.random.default_rng(2)
    model = pendulum(effect)
    active = Effects(model, [effect], start_time=1.5)
    for q, dq in zip(random.uniform(-1, 1, 20), random.uniform(-2, 2, 20), strict=True):
        expected = 0.4 * dq + 1.5 * np.sign(dq) + formula(q, dq, 0.0)
        assert opposing(model, active, q, dq) == pytest.approx(expected, rel=2e-3, abs=2e-3)


@pytest.mark.parametrize("static", [False, True])
def test_friction_that_depends_on_load_sees_the_torque_of_the_links_or_gravity(static) -> None:
    """Static load has no accelerations; the other has those of the step before."""
    numbers = {"driving": 0.1, "driven": 0.04} | ({"static_torque": 1.0} if static else {})
    effect = on("load_dependent_friction", **numbers)
    model = pendulum(effect)
    active = Effects(model, [effect])
    for q, dq in ((0.3, 1.0), (0.3, -1.0), (2.9, 1.0)):
        data = mujoco.MjData(model)
        data.qpos[0], data.qvel[0] = q, dq
        mujoco.mj_forward(model, data)
        moving = np.empty(2)
        mujoco.mj_rne(model, data, 1, moving)
        still = float(data.qfrc_bias[0])
        assert abs(moving[0] - still) > 1.0
        load = still if static else float(moving[0])
        share = 0.1 if load * dq > 0.0 else 0.04
        expected = 0.4 * dq + np.sign(dq) * (1.5 + share * abs(load))
        assert opposing(model, active, q, dq) == pytest.approx(expected, rel=2e-3)


def test_bristles_bend_and_slip_in_the_place_of_dry_friction() -> None:
    """Pulled slowly one way and back: a Maxwell element by its definition."""
    effect = on("presliding", span_1=0.01, level_1=1.5)
    model = pendulum(effect)
    model.opt.timestep = 1e-4
    active, data = Effects(model, [effect]), mujoco.MjData(model)
    model.opt.gravity[:] = 0.0
    q = 0.03 * np.sin(np.linspace(0.0, 2.0 * np.pi, 4000))
    deflection, last = 0.0, 0.0
    for k, position in enumerate(q):
        deflection = float(np.clip(deflection + (position - last) / 0.01, -1.0, 1.0))
        last = position
        data.qpos[0], data.qvel[0], data.time = position, 0.0, 1e-4 * k
        active.apply(model, data)
        assert -data.qfrc_applied[0] == pytest.approx(1.5 * deflection, abs=2e-3)
        assert model.dof_frictionloss[0] <= 1e-9  # all of the dry friction is in the bristle


def test_a_late_and_saturating_drive_acts_with_what_was_commanded_before() -> None:
    effects = [on("time_delay", delay=0.0035), on("torque_saturation", knee=2.0, slope=0.5)]
    model = pendulum()
    model.opt.timestep = 1e-3
    active, data = Effects(model, effects), mujoco.MjData(model)
    commands = np.random.default_rng(1).uniform(-4, 4, 50)
    for k, command in enumerate(commands):
        data.ctrl[0] = command
        active.apply(model, data)
        acting = data.qfrc_applied[0] + command
        sent = commands[np.maximum([k - 3, k - 4], 0)].mean()  # half a step of each
        size = min(abs(sent), 2.0) + 0.5 * max(abs(sent) - 2.0, 0.0)
        assert acting == pytest.approx(np.sign(sent) * size)
        mujoco.mj_step(model, data)


def test_a_position_actuator_sees_what_the_encoder_shows() -> None:
    text = PENDULUM.replace('<motor joint="joint_1"/>', '<position joint="joint_1" kp="50"/>')
    model = mujoco.MjModel.from_xml_string(text)
    active = Effects(model, [on("encoder_eccentricity", sine=0.02, cosine=0.01)])
    data = mujoco.MjData(model)
    data.qpos[0], data.ctrl[0] = 0.7, 0.2
    active.apply(model, data)
    shown = 0.7 + 0.02 * np.sin(0.7) + 0.01 * np.cos(0.7)
    mujoco.mj_forward(model, data)
    assert active.position(data) == pytest.approx([shown])
    assert data.qfrc_actuator[0] + data.qfrc_applied[0] == pytest.approx(50.0 * (0.2 - shown))


MOTIONS = {
    "none": [],
    "stribeck": [on("stribeck", excess=1.2, speed=0.15)],
    "load": [on("load_dependent_friction", driving=0.1, driven=0.05)],
    "load of motor": [on("load_dependent_friction", driving=0.1, driven=0.05, motor_torque=1.0)],
    "static load": [on("load_dependent_friction", driving=0.1, driven=0.05, static_torque=1.0)],
    "position": [on("position_dependent_friction", wave_number_1=3.0, sine_1=0.6)],
    "warmth": [on("friction_drift", time_constant=0.5, coulomb=1.5, viscous=1.0, speed=1.0)],
    "presliding": [on("presliding", span_1=0.003, level_1=1.2)],
    "stiff bristle": [on("presliding", span_1=0.0003, level_1=1.2)],
    "backlash": [on("backlash", gap=0.004, stiffness=30000.0, damping=20.0)],
    "backlash alone": [on("backlash", gap=0.004)],
    "elasticity": [on("elasticity", stiffness=3000.0, damping=5.0)],
    "delay": [on("time_delay", delay=0.0037)],
    "saturation": [on("torque_saturation", knee=15.0, slope=0.5)],
    "eccentricity": [on("encoder_eccentricity", sine=0.005, cosine=0.003, sine_2=0.002)],
    "coupling": [on("joint_coupling", 0, 1, coulomb=0.6, viscous=0.3)],
    "opposite": [on("joint_coupling", 0, 1, coulomb=0.6, viscous=0.3, direction=-1.0)],
    "law": [on("controller_mismatch", kp=900.0, lag=0.003, feedforward_acceleration=0.5)],
}


def test_two_couplings_of_the_same_joints_add_up() -> None:
    both = [on("joint_coupling", 0, 1, coulomb=level, viscous=0.5 * level) for level in (0.6, 0.2)]
    model = pendulum(*both)
    data = mujoco.MjData(model)
    data.qvel[:] = 1.0, 0.5
    Effects(model, both).apply(model, data)
    assert model.tendon_frictionloss[0] == pytest.approx(0.8)
    assert np.ravel(model.tendon_damping)[0] == pytest.approx(0.4)
    assert np.ravel(model.dof_damping.reshape(2, -1)[:, 0]) == pytest.approx([0.4, 0.1])


@pytest.fixture(scope="module")
def arm():
    return arm2(seconds=1.5)


@pytest.mark.parametrize("effects", MOTIONS.values(), ids=MOTIONS)
def test_the_motion_is_that_of_the_other_simulator(effects: list[SimulatedEffect], arm) -> None:
    start, speed = arm.position_reference[0], arm.velocity_reference[0]
    references = References(
        arm.rate, arm.position_reference, arm.velocity_reference, start, speed, 0.0
    )
    compiled_loop = followed(arm, *effects)
    spec = plant_spec(mujoco, arm.robot, arm.truth)
    add_motors(mujoco, spec, JOINTS)
    add_parts(spec, effects)
    model = spec.compile()
    set_inertias(mujoco, model, arm.robot, arm.truth)
    model.dof_solref[:], model.dof_solimp[:] = (2.0 * LONGEST_STEP, 1.0), STIFFEST
    offsets = [
        on("torque_offset", joint, offset=value) for joint, value in enumerate(arm.truth.offset)
    ]
    ran = run_in_mujoco(
        mujoco, model, arm.robot, arm.law, references, arm.truth, [*effects, *offsets]
    )
    assert ran.diverged == ""
    difference = np.sqrt(np.mean((ran.position - compiled_loop.measured_position) ** 2, axis=0))
    # Steps of half a millisecond, of first order there and second order here.
    assert np.all(difference < 1.5e-5), difference


def test_marked_effects_are_passed_over_and_what_the_file_lacks_is_named(tmp_path: Path) -> None:
    planted = [
        {"effect": "stribeck", "joint": "joint_1", "parameters": {"excess": 1.0, "speed": 0.1}},
        {"effect": "stribeck", "joint": "joint_2", "parameters": {"excess": 1.0, "speed": 0.1},
         "native": True},
        {"effect": "elasticity", "joint": "joint_1", "parameters": {"stiffness": 2000.0}},
        {"effect": "controller_mismatch", "joint": "joint_2", "parameters": {"kp": 3.0}},
    ]  # fmt: skip
    xml, path = tmp_path / "arm.xml", tmp_path / "effects.json"
    xml.write_text(PENDULUM, encoding="utf-8")
    path.write_text(json.dumps({"format": "idim_iv_ros/effects/1", "effects": planted}))
    model = model_with_effects(xml, path)
    assert model.joint("joint_1_shaft").id >= 0
    active = Effects(model, path)
    assert active.joints == ("joint_1", "joint_2")
    assert "joint_2" in active.notes[0] and "control law" in active.notes[0]
    bare = mujoco.MjModel.from_xml_path(str(xml))
    with pytest.raises(UsageError, match="no joint joint_1_shaft; build it with model_with"):
        Effects(bare, path)
    model.opt.timestep = 0.05
    with pytest.raises(UsageError, match=r"timestep is 0\.05 s and"):
        Effects(model, path)


@pytest.mark.parametrize(
    ("effect", "words"),
    [
        (on("warp", excess=1.0), "warp is not an effect"),
        (SimulatedEffect("stribeck", "elbow", {"speed": 1.0}), "no joint elbow; they are joint_1"),
        (on("stribeck", pace=1.0), "unknown parameter pace"),
        (on("joint_coupling", 0, 1, coulomb=1.0), "no tendon joint_1_joint_2_coupling"),
    ],
)
def test_effects_that_cannot_be_there_are_refused(effect: SimulatedEffect, words: str) -> None:
    with pytest.raises(UsageError, match=words):
        Effects(mujoco.MjModel.from_xml_string(PENDULUM), [effect])
