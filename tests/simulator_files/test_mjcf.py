"""The exported MuJoCo model, compiled and asked for torques by MuJoCo itself."""

import json
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from idim_iv_ros.model import load_robot
from idim_iv_ros.simulation import SimulatedEffect, control_law
from idim_iv_ros.simulation.effects import contributions_of
from tests.simulator_files.cases import Case, case, cause


def compiled(arm: Case, out: Path) -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_path(str(arm.export(out).mjcf))


def passive(model: mujoco.MjModel, q: float, dq: float, joint: int = 0) -> float:
    """Torque of springs and dampers at one joint, the others at rest."""
    data = mujoco.MjData(model)
    data.qpos[joint], data.qvel[joint] = q, dq
    mujoco.mj_forward(model, data)
    return float(data.qfrc_passive[joint])


@pytest.mark.parametrize(("name", "change"), [("arm7", 0.1), ("tx40", 0.02)])
def test_inverse_dynamics_in_mujoco_are_the_regressor_times_the_parameters(tmp_path, name, change):
    """TX40: the motor of joint 6 turns with joint 5, and is a tendon."""
    arm = case(tmp_path, name, change=change)
    model = compiled(arm, tmp_path / "out")
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_FRICTIONLOSS
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_ACTUATION
    data, random = mujoco.MjData(model), np.random.default_rng(0)
    low, high = arm.model.robot.limits.lower, arm.model.robot.limits.upper
    for _ in range(30):
        q, rates = random.uniform(0.9 * low, 0.9 * high), random.uniform(-2.0, 2.0, (2, len(low)))
        data.qpos[:], data.qvel[:], data.qacc[:] = q, *rates
        mujoco.mj_inverse(model, data)
        expected = arm.model.regressor(q[None], *rates[:, None])[0] @ arm.vector("Fc", "off")
        np.testing.assert_allclose(data.qfrc_inverse, expected, rtol=0.0, atol=1e-5)


def test_friction_and_constant_torques_are_those_of_the_result(tmp_path: Path) -> None:
    arm = case(tmp_path, "arm7")
    model = compiled(arm, tmp_path / "out")
    friction = [arm.standard[f"Fc{joint}"] for joint in range(1, 8)]
    np.testing.assert_allclose(model.dof_frictionloss, friction, rtol=1e-7)
    offset = {f"joint_{joint}": arm.standard[f"off{joint}"] for joint in range(1, 8)}
    effects = json.loads((tmp_path / "out" / "effects.json").read_text())["effects"]
    assert {entry["joint"]: entry["parameters"]["offset"] for entry in effects} == offset
    assert {entry["effect"] for entry in effects} == {"torque_offset"}


def test_actuators_are_the_law_of_the_configuration(tmp_path: Path) -> None:
    """Position and velocity references go in, and the law's torque, limited, comes out."""
    arm = case(tmp_path, "arm7")
    model = compiled(arm, tmp_path / "out")
    law = control_law(arm.configuration.controller, 7)
    data = mujoco.MjData(model)
    random = np.random.default_rng(0)
    for size in (0.001, 0.2):
        q, dq, q_ref, dq_ref = random.uniform(-size, size, (4, 7))
        data.qpos[:], data.qvel[:] = q, dq
        for joint, name in enumerate(arm.model.robot.joints):
            data.actuator(name).ctrl = q_ref[joint]
            data.actuator(f"{name}_velocity").ctrl = dq_ref[joint]
        mujoco.mj_forward(model, data)
        command = law.kp * (q_ref - q) + law.kd * (dq_ref - dq)
        limited = np.clip(command, -law.torque_limit, law.torque_limit)
        np.testing.assert_allclose(data.qfrc_actuator, limited, rtol=0.0, atol=1e-9)
    assert model.opt.timestep == law.period


@pytest.mark.parametrize("power", [2.0, 3.0])
def test_drag_with_a_whole_power_is_the_joints_damping(tmp_path: Path, power: float) -> None:
    planted = cause("nonlinear_viscous", "joint_1", coefficient=0.8, power=power)
    arm = case(tmp_path, "arm2", [planted])
    model = compiled(arm, tmp_path / "out")
    assert json.loads((tmp_path / "out" / "effects.json").read_text())["effects"][0]["native"]
    linear = arm.standard["Fv1"]
    for speed in (0.5, -1.5):
        drag = 0.8 * abs(speed) ** power * np.sign(speed)
        assert passive(model, 0.0, speed) == pytest.approx(-linear * speed - drag, rel=1e-7)


def test_a_spring_over_the_whole_range_is_native_and_one_that_ends_inside_is_not(tmp_path) -> None:
    spring = {"linear": 3.0, "quadratic": -0.5, "cubic": 0.2}
    whole = case(tmp_path, "arm2", [cause("spring", "joint_1", **spring)])
    model = compiled(whole, tmp_path / "whole")
    for q in (0.4, -1.1):
        torque = 3.0 * q - 0.5 * q**2 + 0.2 * q**3
        assert passive(model, q, 0.0) == pytest.approx(-torque, rel=1e-12)
    part = case(tmp_path, "arm2", [cause("spring", "joint_1", **spring, lowest=-0.3, highest=0.3)])
    made = part.export(tmp_path / "part")
    assert made.not_native[0] == "spring at joint_1"
    assert passive(mujoco.MjModel.from_xml_path(str(made.mjcf)), 0.2, 0.0) == 0.0


def test_friction_between_two_joints_is_a_tendon(tmp_path: Path) -> None:
    planted = cause(
        "joint_coupling", "joint_1", direction=-1.0, coulomb=0.4, viscous=0.3, power=1.0
    )
    arm = case(tmp_path, "arm2", [{**planted, "other_joint": "joint_2"}])
    model = compiled(arm, tmp_path / "out")
    data = mujoco.MjData(model)
    data.qvel[:] = 0.6, -0.2
    mujoco.mj_forward(model, data)
    common = 0.3 * (0.6 + 0.2)
    expected = [arm.standard["Fv1"] * 0.6 + common, arm.standard["Fv2"] * -0.2 - common]
    np.testing.assert_allclose(-data.qfrc_passive, expected, rtol=1e-7)
    assert model.tendon_frictionloss[0] == 0.4


def test_a_delayed_command_acts_that_much_later(tmp_path: Path) -> None:
    """4 ms at a period of 1 ms; the actuators are motors then, whose control is the torque."""
    arm = case(tmp_path, "arm2", [cause("time_delay", None, delay=0.004)])
    model = compiled(arm, tmp_path / "out")
    period = model.opt.timestep
    data, forces = mujoco.MjData(model), []
    for step in range(12):
        data.ctrl[:] = step + 1.0
        mujoco.mj_step(model, data)
        forces.append(float(data.actuator_force[0]))
    late = round(0.004 / period)
    np.testing.assert_allclose(forces[late:], np.arange(1.0, 13.0 - late), atol=1e-12)
    np.testing.assert_allclose(model.numeric("delay").data, 0.004)


def test_a_drive_that_saturates_hard_has_a_smaller_limit(tmp_path: Path) -> None:
    arm = case(tmp_path, "arm2", [cause("torque_saturation", "joint_1", knee=5.0, slope=0.0)])
    model = compiled(arm, tmp_path / "out")
    data = mujoco.MjData(model)
    data.actuator("joint_1").ctrl = 3.0
    mujoco.mj_forward(model, data)
    assert data.qfrc_actuator[0] == 5.0


def test_gains_that_the_robot_really_has_take_the_place_of_those_configured(tmp_path) -> None:
    arm = case(tmp_path, "arm2", [cause("controller_mismatch", "joint_2", kp=123.0)])
    assert compiled(arm, tmp_path / "out").actuator("joint_2").gainprm[0] == 123.0
    lag = case(tmp_path, "arm2", [cause("controller_mismatch", "joint_2", kp=123.0, lag=0.01)])
    assert lag.export(tmp_path / "lag").not_native[0] == "controller_mismatch at joint_2"


@pytest.mark.parametrize("effect", ["stribeck", "presliding", "backlash", "friction_drift"])
def test_what_mujoco_has_no_element_for_is_in_the_file_as_simulate_takes_it(tmp_path, effect):
    numbers = {
        "stribeck": {"excess": 1.0, "speed": 0.1, "exponent": 2.0},
        "presliding": {"span_1": 0.001, "level_1": 0.3},
        "backlash": {"gap": 0.002},
        "friction_drift": {"time_constant": 30.0, "coulomb": 0.5},
    }[effect]
    made = case(tmp_path, "arm2", [cause(effect, "joint_1", **numbers)]).export(tmp_path / "out")
    assert made.not_native[0] == f"{effect} at joint_1"
    planted, *_ = json.loads(made.effects.read_text())["effects"]
    assert planted["parameters"] == numbers and not planted["native"]
    one = SimulatedEffect(planted["effect"], planted["joint"], planted["parameters"])
    assert contributions_of([one], ["joint_1", "joint_2"]).items


def test_friction_below_zero_that_an_effect_makes_up_for_is_an_effect_too(tmp_path: Path) -> None:
    """URDF, model and effects together are the robot that was found: −0.4 v + 0.9 |v| v."""
    planted = cause("nonlinear_viscous", "joint_1", coefficient=0.9, power=2.0)
    arm = case(tmp_path, "arm2", [planted])
    parameters = tuple(
        replace(entry, value=-0.4) if entry.name == "Fv1" else entry
        for entry in arm.gap.physical.parameters
    )
    physical = replace(arm.gap.physical, parameters=parameters, shared=("Fv1", "Fc1"))
    made = arm.with_gap(physical=physical).export(tmp_path / "out")
    assert passive(mujoco.MjModel.from_xml_path(str(made.mjcf)), 0.0, 1.5) == pytest.approx(
        -0.9 * 1.5**2
    )
    effects = json.loads(made.effects.read_text(encoding="utf-8"))["effects"]
    rest = [
        entry for entry in effects if not entry["native"] and entry["effect"] != "torque_offset"
    ]
    assert [entry["parameters"] for entry in rest] == [{"coefficient": -0.4, "power": 1.0}]
    robot = load_robot(made.urdf.read_text(encoding="utf-8"), ["joint_1", "joint_2"])
    assert robot.given.viscous[0] == 0.0
