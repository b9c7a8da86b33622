"""Files for learning: actuators of Isaac Lab, and ranges to draw robots from."""

import runpy
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import mujoco
import numpy as np
import pytest

from idim_iv_ros.errors import UsageError
from idim_iv_ros.model.parameters import INERTIAL, REGRESSOR_ORDER
from idim_iv_ros.physical import nearest_physical
from tests.simulator_files.cases import Case, case, cause
from tests.simulator_files.test_named import BODY, friction, payload, torque

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


DRAWS = 60


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> Case:
    """A recording of the nominal model with its causes, each number to 2 %."""
    causes = [payload("joint_7"), friction("joint_4")]
    arm = case(tmp_path_factory.mktemp("arm"), "arm7", causes)
    layout, base = arm.model.regressor.layout, arm.model.base
    standard = layout.vector(arm.model.robot.given)
    standard[[layout.names.index(f"{kind}7") for kind in INERTIAL]] += BODY[list(REGRESSOR_ORDER)]
    standard[layout.names.index("Fv4")] += 0.34
    standard[layout.names.index("Fc4")] += 1.66
    values = base.grouping @ standard
    covariance = np.diag((0.02 * np.abs(values) + 1e-4) ** 2)
    return arm.with_gap(physical=nearest_physical(arm.model.robot, base, values, covariance))


@pytest.fixture(scope="module")
def drawn(
    arm: Case, tmp_path_factory: pytest.TempPathFactory
) -> tuple[mujoco.MjModel, list[mujoco.MjModel]]:
    made = arm.export(tmp_path_factory.mktemp("out") / "out", refit=False, randomize=True)
    model = mujoco.MjModel.from_xml_path(str(made.mjcf))
    sample = runpy.run_path(str(made.ranges))["sample"]
    random = np.random.default_rng(0)
    return model, [sample(model, random) for _ in range(DRAWS)]


def test_draws_are_bodies_about_the_exported_ones(arm, drawn) -> None:
    model, draws = drawn
    masses = np.array([drawn.body_mass for drawn in draws])
    present = model.body_mass > 0.0
    spread = masses.std(axis=0)[present] / model.body_mass[present]
    assert np.all(spread > 0.004) and np.all(spread < 0.3)
    off = np.abs(masses.mean(axis=0) - model.body_mass)[present]
    assert np.all(off < 4.0 * masses.std(axis=0)[present] / np.sqrt(DRAWS))
    for drawn in draws:
        moments = np.sort(drawn.body_inertia[present], axis=1)
        assert np.all(moments[:, 0] > 0.0)
        assert np.all(moments[:, 2] <= moments[:, :2].sum(axis=1) * (1.0 + 1e-9))


def test_what_the_recording_shows_hardly_varies(drawn) -> None:
    """Torques stay within 2 %, the covariance's, though parts of them vary by more."""
    _, draws = drawn
    states = np.random.default_rng(1).uniform(-1.5, 1.5, (20, 3, 7))
    together = np.array([[torque(drawn, *state) for state in states] for drawn in draws])
    assert together.std(axis=0).mean() < 0.02 * np.sqrt(np.mean(together**2))


def test_a_draw_is_of_its_seed_and_leaves_the_model(arm: Case, tmp_path: Path) -> None:
    made = arm.export(tmp_path / "out", refit=False, randomize=True, without=["payload"])
    model = mujoco.MjModel.from_xml_path(str(made.mjcf))
    before = model.body_mass.copy()
    sample = runpy.run_path(str(made.ranges))["sample"]
    first, again, other = (sample(model, np.random.default_rng(seed)) for seed in (1, 1, 2))
    np.testing.assert_array_equal(first.body_mass, again.body_mass)
    assert np.all(first.dof_damping >= 0.0) and np.any(first.dof_damping != other.dof_damping)
    np.testing.assert_array_equal(model.body_mass, before)
    assert '("load"' not in made.ranges.read_text(encoding="utf-8")
    table = made.changes.read_text(encoding="utf-8")
    assert table.count("\n| joint_") >= 7 and "## Ranges" in table


def test_one_refit_has_no_ranges(arm: Case, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="names no causes"):
        arm.export(tmp_path / "out", randomize=True)
