"""Ranges for domain randomisation: what varies is what the recording leaves open."""

import runpy
from pathlib import Path

import mujoco
import numpy as np
import pytest

from idim_iv_ros.errors import UsageError
from idim_iv_ros.model.parameters import INERTIAL, REGRESSOR_ORDER
from idim_iv_ros.physical import nearest_physical
from tests.simulator_files.cases import Case, case
from tests.simulator_files.test_named import BODY, friction, payload, torque

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
    random = np.random.default_rng(1)
    states = random.uniform(-1.5, 1.5, (20, 3, 7))
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
