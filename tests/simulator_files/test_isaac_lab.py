"""The file for Isaac Lab, read by Python with stand-ins that know the documented fields.

Isaac Lab itself does not run here: what is tested is that the file is Python, that it uses only
fields that its documentation has (ActuatorBaseCfg and actuator_pd_cfg.py of 2.3 and 3.0), and that
their values are those of the result.
"""

import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest

from tests.simulator_files.cases import Case, case, cause

BASE = {
    *("joint_names_expr", "effort_limit", "velocity_limit", "effort_limit_sim", "stiffness"),
    *("velocity_limit_sim", "damping", "armature", "friction", "dynamic_friction"),
    "viscous_friction",
}
FIELDS = {"IdealPDActuatorCfg": BASE, "DelayedPDActuatorCfg": BASE | {"min_delay", "max_delay"}}


def recorder(name: str, fields: set[str] | None = None) -> Any:
    def make(**given: Any) -> SimpleNamespace:
        assert fields is None or set(given) <= fields, (name, set(given) - (fields or set()))
        return SimpleNamespace(kind=name, **given)

    return make


def read(arm: Case, out: Path, monkeypatch: pytest.MonkeyPatch) -> tuple[SimpleNamespace, str]:
    """What the file defines, and its first words."""
    sim, actuators, assets = (
        ModuleType(f"isaaclab.{name}") for name in ("sim", "actuators", "assets")
    )
    converter = recorder("UrdfConverterCfg.JointDriveCfg", {"gains"})
    converter.PDGainsCfg = recorder("PDGainsCfg", {"stiffness", "damping"})
    spawn = {"asset_path", "fix_base", "joint_drive"}
    sim.UrdfFileCfg = recorder("UrdfFileCfg", spawn)  # type: ignore[attr-defined]
    sim.UrdfConverterCfg = SimpleNamespace(JointDriveCfg=converter)  # type: ignore[attr-defined]
    assets.ArticulationCfg = recorder(  # type: ignore[attr-defined]
        "ArticulationCfg", {"spawn", "actuators"}
    )
    for name, fields in FIELDS.items():
        setattr(actuators, name, recorder(name, fields))
    package = ModuleType("isaaclab")
    package.sim = sim  # type: ignore[attr-defined]
    for module in (package, sim, actuators, assets):
        monkeypatch.setitem(sys.modules, module.__name__, module)
    made = arm.export(out)
    scope: dict[str, Any] = {"__file__": str(made.isaac_lab)}
    exec(compile(made.isaac_lab.read_text(encoding="utf-8"), "isaac_lab.py", "exec"), scope)
    return scope["ROBOT_CFG"], scope["__doc__"]


def test_actuators_have_the_values_of_the_result(tmp_path, monkeypatch) -> None:
    arm = case(tmp_path, "arm7")
    robot, words = read(arm, tmp_path / "out", monkeypatch)
    (group,) = robot.actuators.values()
    joints = list(arm.model.robot.joints)
    assert group.kind == "IdealPDActuatorCfg" and group.joint_names_expr == joints
    for field, kind in (
        ("armature", "Ia"),
        ("viscous_friction", "Fv"),
        ("dynamic_friction", "Fc"),
        ("friction", "Fc"),
    ):
        expected = [arm.standard[f"{kind}{joint}"] for joint in range(1, 8)]
        assert list(getattr(group, field).values()) == expected
    assert list(group.stiffness.values()) == arm.configuration.controller.kp
    assert list(group.effort_limit.values()) == arm.configuration.controller.torque_limit
    assert Path(robot.spawn.asset_path) == tmp_path / "out" / "arm7.urdf"
    assert "not run there" in words


def test_a_delay_is_in_physics_steps_and_what_has_no_field_is_said(tmp_path, monkeypatch) -> None:
    """Joints of one delay are a group."""
    late = cause("time_delay", "joint_3", delay=0.0042)
    arm = case(tmp_path, "arm7", [late, cause("stribeck", "joint_2", excess=1.25, speed=0.1)])
    robot, words = read(arm, tmp_path / "out", monkeypatch)
    assert arm.configuration.controller.period == 0.001
    group = robot.actuators["delayed_4"]
    assert group.joint_names_expr == ["joint_3"]
    assert group.min_delay == group.max_delay == 4
    assert robot.actuators["delayed_0"].max_delay == 0
    assert "stribeck at joint_2: excess 1.25, speed 0.1" in words
    assert f"joint_1 {arm.standard['off1']:.6g}" in words
