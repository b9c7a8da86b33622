"""The nominal model with named causes: right torques, and the nominal file without them."""

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pinocchio as pin
import pytest

from idim_iv_ros.errors import UsageError
from idim_iv_ros.model.parameters import INERTIAL
from tests.model.mjcf_robots import ARMS
from tests.simulator_files.cases import CONFIG, Case, case
from tests.simulator_files.cases import cause as structural
from tests.simulator_files.test_kept_mjcf import arm_of

MASS, CENTRE, MOMENTS = 0.8, np.array([0.02, -0.015, 0.06]), np.diag([1.5e-3, 1.5e-3, 8e-4])
BODY = pin.Inertia(MASS, CENTRE, MOMENTS).toDynamicParameters()


def parametric(effect: str, joint: str | None, std: float, **values: float) -> dict[str, Any]:
    numbers = {name: {"value": value, "std": std, "unit": "SI"} for name, value in values.items()}
    return structural(effect, joint) | {"kind": "parametric", "parameters": numbers}


def payload(joint: str, *without: str) -> dict[str, Any]:
    names = ("mass", "moment_x", "moment_y", "moment_z", "inertia_xx", "inertia_xy", "inertia_yy",
             "inertia_xz", "inertia_yz", "inertia_zz")  # fmt: skip
    numbers = {
        name: float(value)
        for name, value in zip(names, BODY, strict=True)
        if not name.startswith(without or ("no",))
    }
    return parametric("payload", joint, 1e-9, **numbers)


def friction(joint: str) -> dict[str, Any]:
    return parametric("friction_level", joint, 1e-9, change_of_viscous=0.34, change_of_coulomb=1.66)


def torque(model: mujoco.MjModel, *state: np.ndarray) -> np.ndarray:
    data = mujoco.MjData(model)
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    data.qpos[:], data.qvel[:], data.qacc[:] = state
    mujoco.mj_inverse(model, data)
    return np.array(data.qfrc_inverse)


@pytest.fixture
def arm(tmp_path: Path) -> Case:
    return case(tmp_path, "arm7", [payload("joint_7"), friction("joint_4")])


def test_torques_are_those_of_the_nominal_model_with_the_causes(arm: Case, tmp_path: Path) -> None:
    """In MuJoCo and in pinocchio, at random states."""
    made = arm.export(tmp_path / "out", refit=False)
    model = mujoco.MjModel.from_xml_path(str(made.mjcf))
    tree = pin.buildModelFromUrdf(str(made.urdf))
    names = arm.model.regressor.layout.names
    standard = dict(
        zip(names, arm.model.regressor.layout.vector(arm.model.robot.given), strict=True)
    )
    kinds = ("M", "MX", "MY", "MZ", "XX", "XY", "YY", "XZ", "YZ", "ZZ")
    for kind, value in zip(kinds, BODY, strict=True):
        standard[f"{kind}7"] += value
    standard["Fv4"] += 0.34
    values = np.array([0.0 if name[:2] in ("Fc", "of") else standard[name] for name in names])
    random = np.random.default_rng(2)
    for _ in range(10):
        state = random.uniform(-1.5, 1.5, (3, 7))
        expected = arm.model.regressor(*(item[None] for item in state))[0] @ values
        np.testing.assert_allclose(torque(model, *state), expected, rtol=0.0, atol=1e-7)
        drives = np.array(
            [
                standard[f"Ia{k}"] * a + standard[f"Fv{k}"] * v
                for k, (v, a) in enumerate(state[1:].T, 1)
            ]
        )
        exported = pin.rnea(tree, tree.createData(), *state) + drives
        np.testing.assert_allclose(exported, expected, rtol=0.0, atol=1e-7)
    assert model.dof_frictionloss[3] == pytest.approx(arm.model.robot.given.coulomb[3] + 1.66)


def test_a_payload_is_a_body_of_its_own_with_its_interval(arm: Case, tmp_path: Path) -> None:
    made = arm.export(tmp_path / "out", refit=False)
    model = mujoco.MjModel.from_xml_path(str(made.mjcf))
    assert model.body("payload").mass[0] == pytest.approx(MASS)
    np.testing.assert_allclose(model.body("payload").ipos, CENTRE, rtol=1e-7)
    assert model.body(model.body("payload").parentid[0]).name == "link_7"
    for file in (made.mjcf, made.urdf):
        assert re.search(r"<!-- payload@joint_7: .*mass 0\.8 ± 2e-09 SI", file.read_text())
    given = pin.buildModelFromUrdf(str(CONFIG / "arm7.urdf"))
    exported = pin.buildModelFromUrdf(str(made.urdf))
    for before, after in zip(list(given.inertias)[:-1], list(exported.inertias)[:-1], strict=True):
        np.testing.assert_array_equal(before.toDynamicParameters(), after.toDynamicParameters())


def test_without_all_causes_it_is_the_file_that_was_given(arm: Case, tmp_path: Path) -> None:
    nominal = (CONFIG / "arm7.urdf").read_bytes()
    made = arm.export(tmp_path / "a", refit=False, without=["payload", "friction_level@joint_4"])
    assert made.urdf.read_bytes() == nominal
    made = arm.export(tmp_path / "b", refit=False, without=["payload"])
    changed = [
        (old, new)
        for old, new in zip(nominal.splitlines(), made.urdf.read_bytes().splitlines(), strict=True)
        if old != new
    ]
    assert len(changed) == 1 and b"<dynamics" in changed[0][1]
    assert "left out: payload@joint_7" in made.changes.read_text(encoding="utf-8")


def test_what_remains_stays_where_a_cause_is_left_out(arm: Case, tmp_path: Path) -> None:
    """Estimates are 10 % off the nominal model: links take it, and keep it without the payload."""
    named = arm.export(tmp_path / "named", refit=False)
    whole = arm.export(tmp_path / "a", refit=False, remainder=True)
    bare = arm.export(tmp_path / "b", refit=False, remainder=True, without=["payload"])
    models = [mujoco.MjModel.from_xml_path(str(item.mjcf)) for item in (named, whole, bare)]
    links = slice(0, models[2].nbody)
    np.testing.assert_array_equal(models[1].body_mass[links], models[2].body_mass)
    np.testing.assert_array_equal(models[1].dof_frictionloss, models[2].dof_frictionloss)
    estimate = {item.name: item for item in arm.gap.physical.base}
    names = [name for name in estimate if name[:2] in ("Fv", "Fc") and name[2] != "4"]
    for model, most in zip(models, (8.0, 1.0), strict=False):
        exported = {
            **{f"Fv{joint + 1}": value for joint, value in enumerate(model.dof_damping.ravel())},
            **{f"Fc{joint + 1}": value for joint, value in enumerate(model.dof_frictionloss)},
        }
        missed = [(exported[name] - estimate[name].estimate) / estimate[name].std for name in names]
        assert np.sqrt(np.mean(np.square(missed))) < most


@pytest.mark.parametrize("effect", ["torque_gain", "gravity_direction"])
def test_what_remains_is_not_spread_beside_what_is_no_number_of_a_body(effect, tmp_path) -> None:
    arm = case(tmp_path, "arm2", [parametric(effect, None, 1e-3, gain=1.1)])
    with pytest.raises(UsageError, match=f"beside {effect}.*leave out --remainder"):
        arm.export(tmp_path / "out", refit=False, remainder=True)


def test_a_users_mjcf_gets_a_body_and_nothing_else(tmp_path: Path) -> None:
    """Wherever its joint's anchor is: the body is placed at the anchor."""
    text, joints, _ = ARMS["iiwa14"]
    arm = arm_of(tmp_path, text, joints, [payload(joints[-1])])
    kept = arm.export(tmp_path / "out", refit=False)
    plain = arm.export(tmp_path / "plain", refit=False, without=["payload"])
    assert plain.mjcf.read_bytes().decode() == text
    added = kept.mjcf.read_text(encoding="utf-8")
    start = added.index("<!-- payload@")
    end = added.index("</body>", start) + len("</body>")
    assert re.sub(r"\s+", "", added[:start] + added[end:]) == re.sub(r"\s+", "", text)


def test_what_is_not_shown_of_a_payload_is_that_of_a_ball_of_water(tmp_path: Path) -> None:
    arm = case(tmp_path, "arm7", [payload("joint_7", "inertia")])
    made = arm.export(tmp_path / "out", refit=False)
    body = mujoco.MjModel.from_xml_path(str(made.mjcf)).body("payload")
    radius = (3.0 * MASS / (4.0 * np.pi * 1000.0)) ** (1.0 / 3.0)
    np.testing.assert_allclose(body.ipos, CENTRE, atol=1e-6)
    np.testing.assert_allclose(body.inertia, 0.4 * MASS * radius**2, rtol=1e-3)
    assert "the rest as of a ball of water" in made.urdf.read_text(encoding="utf-8")


def test_a_missing_part_is_taken_out_of_its_link(tmp_path: Path) -> None:
    given = case(tmp_path, "arm7").model.robot.given.inertial[6]
    lighter = parametric("payload", "joint_7", 1e-9, mass=-0.1 * float(given[0]))
    made = case(tmp_path, "arm7", [lighter]).export(tmp_path / "out", refit=False)
    model = mujoco.MjModel.from_xml_path(str(made.mjcf))
    assert model.body("link_7").mass[0] == pytest.approx(0.9 * given[0], rel=1e-6)


def test_numbers_of_a_link_that_are_shown_take_the_others_with_them(tmp_path: Path) -> None:
    """A link 12 % too light, of which the recording shows all but the mass and its z."""
    arm = case(tmp_path, "arm7")
    names = {kind: f"{kind}3" for kind in INERTIAL if kind not in ("M", "MZ")}
    layout = arm.model.regressor.layout
    given = dict(zip(layout.names, layout.vector(arm.model.robot.given), strict=True))
    changes = {f"change_of_{name}": 0.12 * given[name] for name in names.values()}
    more = parametric("link_inertia", "joint_3", 1e-6, **changes)
    made = case(tmp_path, "arm7", [more]).export(tmp_path / "out", refit=False)
    exported = pin.buildModelFromUrdf(str(made.urdf)).inertias[3].toDynamicParameters()
    assert exported[0] == pytest.approx(1.12 * given["M3"], rel=0.03)
    assert exported[4] == pytest.approx(1.12 * given["XX3"], abs=1e-5)


def test_a_link_that_is_heavier_keeps_its_shape(tmp_path: Path) -> None:
    heavier = parametric("link_inertia", "joint_3", 1e-6, relative_change_of_mass=0.2)
    arm = case(tmp_path, "arm7", [heavier])
    made = arm.export(tmp_path / "out", refit=False)
    exported = pin.buildModelFromUrdf(str(made.urdf)).inertias[3].toDynamicParameters()
    given = arm.model.robot.given.inertial[2]
    np.testing.assert_allclose(exported, 1.2 * given, rtol=1e-5, atol=1e-9)


def test_a_link_whose_centre_of_mass_is_elsewhere_keeps_its_mass(tmp_path: Path) -> None:
    names = {f"shift_of_centre_of_mass_along_{axis}": 0.01 * k for k, axis in enumerate("xyz")}
    moved = parametric("link_inertia", "joint_3", 1e-6, **names)
    arm = case(tmp_path, "arm7", [moved])
    made = arm.export(tmp_path / "out", refit=False)
    exported = pin.buildModelFromUrdf(str(made.urdf)).inertias[3]
    given = pin.Inertia.FromDynamicParameters(arm.model.robot.given.inertial[2])
    np.testing.assert_allclose(exported.lever, given.lever + np.array([0.0, 0.01, 0.02]), atol=1e-5)
    np.testing.assert_allclose(exported.inertia, given.inertia, rtol=1e-3, atol=1e-6)
    assert exported.mass == pytest.approx(given.mass)


def test_friction_beside_an_effect_of_friction_goes_with_it(tmp_path: Path) -> None:
    planted = structural("stribeck", "joint_2", excess=1.0, speed=0.2)
    arm = case(tmp_path, "arm2", [planted, friction("joint_2")])
    arm = arm.with_gap(physical=replace(arm.gap.physical, shared=("Fv2", "Fc2")))
    given, refit = arm.model.robot.given.coulomb[1], arm.standard["Fc2"]
    for without, expected in (
        ([], refit),
        (["friction_level"], max(refit - 1.66, 0.0)),
        (["stribeck"], given + 1.66),
        (["stribeck", "friction_level"], given),
    ):
        made = arm.export(tmp_path / f"out{len(without)}{without}", refit=False, without=without)
        model = mujoco.MjModel.from_xml_path(str(made.mjcf))
        assert model.dof_frictionloss[1] == pytest.approx(expected, rel=1e-7)


def test_gravity_that_is_turned_is_in_a_model_made_from_a_urdf(tmp_path: Path) -> None:
    tilt = parametric("gravity_direction", None, 1e-9, rotation_about_x=0.05, rotation_about_y=0.0)
    made = case(tmp_path, "arm7", [tilt]).export(tmp_path / "out", refit=False)
    model = mujoco.MjModel.from_xml_path(str(made.mjcf))
    expected = 9.81 * np.array([0.0, np.sin(0.05), -np.cos(0.05)])
    np.testing.assert_allclose(model.opt.gravity, expected, atol=1e-9)
    assert any(note.startswith("gravity_direction: robot.gravity") for note in made.notes)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"without": ["tilt"]}, r"no cause tilt .*: payload@joint_7, friction_level@joint_4"),
        ({"without": ["payload@joint_6"]}, "no cause payload@joint_6"),
        ({"without": ["payload"], "refit": True}, "one dense refit has no causes"),
        ({"remainder": True, "refit": True}, "one dense refit names no causes"),
    ],
)
def test_unknown_causes_are_refused_in_one_line(arm, tmp_path, options, words) -> None:
    with pytest.raises(UsageError, match=words):
        arm.export(tmp_path / "out", **{"refit": False} | options)
    assert not (tmp_path / "out").exists()
