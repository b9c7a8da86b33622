"""The user's own MJCF with the values of a result: right in MuJoCo, unchanged everywhere else."""

# ruff: noqa: E501  # lines of MJCF

import difflib
import json
import re
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import mujoco
import numpy as np
import pytest

from idim_iv_ros.configuration import Configuration
from tests.model.mjcf_robots import ARMS, GEN3
from tests.model.test_mjcf import ARM2, simulator
from tests.simulator_files.cases import CHANGING, Case, bare, case, cause, refused

# Each with one joint to a body.
ONE_EACH = ("ur5e", "iiwa14", "xarm7")


def configured(path: Path, joints: tuple[str, ...]) -> Configuration:
    return Configuration.model_validate({"robot": {"mjcf": path, "joints": list(joints)}})


def arm_of(folder: Path, text: str, joints: tuple[str, ...], causes=(), change=0.03) -> Case:
    path = folder / "arm.xml"
    path.write_bytes(text.encode())
    return case(folder, configured(path, joints), causes, change=change)


def two_joints(folder: Path, text: str, causes=()) -> Case:
    return arm_of(folder, text, ("joint_1", "joint_2"), causes)


def assert_same_torques(arm: Case, text: str, start_of: str) -> None:
    """MuJoCo's inverse dynamics against the regressor; dry friction is a constraint there."""
    model, before = simulator(text), simulator(start_of)
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_SPRING
    data, joints = mujoco.MjData(model), arm.model.robot.joints
    place = [model.joint(joint).qposadr[0] for joint in joints]
    dofs = [model.joint(joint).dofadr[0] for joint in joints]
    random, standard = np.random.default_rng(4), arm.vector("Fc", "off")
    for _ in range(20):
        q, dq, ddq = random.uniform(-2.0, 2.0, (3, len(joints)))
        data.qpos[:] = before.key_qpos[0] if before.nkey else before.qpos0
        data.qpos[place], data.qvel[:], data.qacc[:] = q, 0.0, 0.0
        data.qvel[dofs], data.qacc[dofs] = dq, ddq
        mujoco.mj_inverse(model, data)
        expected = arm.model.regressor(q[None], dq[None], ddq[None])[0] @ standard
        np.testing.assert_allclose(data.qfrc_inverse[dofs], expected, rtol=0.0, atol=1e-5)
    friction = [arm.standard[f"Fc{k + 1}"] for k in range(len(joints))]
    np.testing.assert_allclose(model.dof_frictionloss[dofs], friction, rtol=1e-7)


@pytest.mark.parametrize("name", ONE_EACH)
def test_inverse_dynamics_in_mujoco_are_the_regressor_times_the_parameters(name, tmp_path) -> None:
    text, joints, _ = ARMS[name]
    arm = arm_of(tmp_path, text, joints)
    made = arm.export(tmp_path / "out")
    written = made.mjcf.read_text(encoding="utf-8")
    assert_same_torques(arm, written, text)
    with pytest.raises(AssertionError):  # the file that was there before has other torques
        assert_same_torques(arm, text, text)
    names = sorted(path.name for path in (tmp_path / "out").iterdir())
    assert names == ["arm.xml", "changes.md", "effects.json"]


@pytest.mark.parametrize("name", ONE_EACH)
def test_values_change_and_nothing_else(name: str, tmp_path: Path) -> None:
    text, joints, _ = ARMS[name]
    text = text.replace("<worldbody>", "<!-- mass='1' > armature -->\r\n\t<worldbody >", 1)
    arm = arm_of(tmp_path, text, joints)
    made = arm.export(tmp_path / "out")
    after = made.mjcf.read_bytes().decode()
    assert after != text and bare(after, CHANGING) == bare(text, CHANGING)
    # And what is fixed, locked or of another body has the values it had, unless a note says why not.
    if any("changed together" in note for note in made.notes):
        return
    kept = [entry for entry in _inertials(text) if entry in _inertials(after)]
    assert len(kept) == len(_inertials(text)) - len(joints)


def _inertials(text: str) -> list[dict[str, str]]:
    return [element.attrib for element in ElementTree.fromstring(text).iter("inertial")]


def test_what_an_inertial_is_written_as_stays(tmp_path: Path) -> None:
    text, joints, _ = ARMS["ur5e"]
    after = arm_of(tmp_path, text, joints).export(tmp_path / "out").mjcf.read_text()
    bodies = {
        body.get("name"): body.find("inertial").attrib
        for body in ElementTree.fromstring(after).iter("body")
    }
    assert set(bodies["forearm_link"]) == {"mass", "pos", "fullinertia"}
    assert set(bodies["upper_arm_link"]) == {"mass", "pos", "quat", "diaginertia"}
    # Near the axes of the file: neither order nor signs jump.
    quat = np.array([float(entry) for entry in bodies["upper_arm_link"]["quat"].split()])
    given = np.array([0.9, 0.1, 0.2, 0.1]) / np.linalg.norm([0.9, 0.1, 0.2, 0.1])
    assert abs(quat @ given) > 0.9


def test_other_ways_to_turn_an_inertial_become_a_quaternion(tmp_path: Path) -> None:
    text, joints, _ = ARMS["ur5e"]
    turned = text.replace('quat="0.9 0.1 0.2 0.1"', 'euler="0.1 0.4 0.2"')
    assert turned != text
    arm = arm_of(tmp_path, turned, joints)
    written = arm.export(tmp_path / "out").mjcf.read_text()
    assert "euler" not in written
    assert_same_torques(arm, written, turned)


def test_inertia_of_geoms_becomes_an_inertial_and_the_geoms_stay(tmp_path: Path) -> None:
    inertial = '<inertial pos="0.15 -0.008 0.003" mass="2.3" fullinertia="0.00140875 0.022861 0.022861 0 -0.0005 0"/>'
    text = ARM2.replace(inertial, '<geom type="capsule" size="0.05 0.1" pos="0.1 0 0.02"/>')
    arm = two_joints(tmp_path, text)
    made = arm.export(tmp_path / "out")
    written = made.mjcf.read_text(encoding="utf-8")
    assert_same_torques(arm, written, text)
    added = [line for line in difflib.ndiff(text.splitlines(), written.splitlines()) if line.startswith("+ ") and "<inertial" in line]  # fmt: skip
    assert len(added) == 2 and '<geom type="capsule"' in written
    assert any("the inertia of link_2 was that of geoms" in note for note in made.notes)


@pytest.mark.skipif(
    not hasattr(mujoco.MjModel, "actuator_armature"), reason="MuJoCo is older than 3.5"
)
def test_what_actuators_have_is_taken_out_of_the_joint(tmp_path: Path) -> None:
    motor = '<actuator><motor joint="joint_2" gear="3" armature="{}"/></actuator></mujoco>'
    text = ARM2.replace("</mujoco>", motor.format(0.005))
    arm = two_joints(tmp_path, text)
    assert_same_torques(arm, arm.export(tmp_path / "out").mjcf.read_text(), text)
    heavy = two_joints(tmp_path, ARM2.replace("</mujoco>", motor.format(0.005)))
    given = replace(
        heavy.gap.physical,
        parameters=tuple(
            replace(entry, value=0.01) if entry.name == "Ia2" else entry
            for entry in heavy.gap.physical.parameters
        ),
    )
    refused(heavy.with_gap(physical=given), tmp_path / "no", r"joint_2: its actuators alone have")


def test_effects_are_all_for_the_callbacks(tmp_path: Path) -> None:
    planted = [
        cause("nonlinear_viscous", "joint_1", coefficient=0.8, power=2.0),
        cause("stribeck", "joint_2", excess=1.0, speed=0.2),
    ]
    arm = two_joints(tmp_path, ARM2, planted)
    made = arm.export(tmp_path / "out")
    effects = json.loads(made.effects.read_text())["effects"]
    assert [entry["effect"] for entry in effects[:2]] == ["nonlinear_viscous", "stribeck"]
    assert {entry["effect"] for entry in effects[2:]} == {"torque_offset"}
    assert not any(entry["native"] for entry in effects)
    page = made.changes.read_text(encoding="utf-8")
    assert "URDF" not in page.replace("needs a URDF", "") and "torque_offset: [" in page


@pytest.mark.parametrize(
    "setting",
    ['inertiafromgeom="true"', 'balanceinertia="true"', 'boundmass="0.1"', 'settotalmass="7"',
     'boundinertia="0.0001"', 'fusestatic="true"'],
)  # fmt: skip
@pytest.mark.filterwarnings("ignore:compiler attribute 'settotalmass'")
def test_settings_that_change_inertials_are_refused_by_name(setting: str, tmp_path: Path) -> None:
    text = ARM2.replace("<compiler ", f"<compiler {setting} ")
    for link in ("link_1", "link_2"):
        text = re.sub(rf'(<body name="{link}"[^>]*>)', r'\1<geom size="0.1"/>', text)
    refused(two_joints(tmp_path, text), tmp_path / "out", re.escape(setting.split("=")[0]))


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({'<body name="link_2"': "<body"}, "body_2 is no named <body>"),
        (
            {
                "</worldbody>": '<replicate count="2" offset="1 0 0"><body><geom size="0.1"/></body>'
                "</replicate></worldbody>"
            },
            "<replicate>.*write them out",
        ),
        # Its own damping would be counted again by the effects of the new result.
        (
            {
                'damping="0.5"': 'damping="0.5 0.3 0"',
                "<worldbody>": '<custom><tuple name="nonlinear_viscous"><element objtype="joint" objname="joint_2"/></tuple></custom><worldbody>',
            },
            "nonlinear_viscous of an earlier export",
        ),
    ],
)
def test_bodies_and_values_without_a_place_are_refused(changes, words, tmp_path) -> None:
    text = ARM2
    for old, new in changes.items():
        assert old in text
        text = text.replace(old, new)
    refused(two_joints(tmp_path, text), tmp_path / "out", words)


def test_a_scene_that_includes_the_arm_is_refused(tmp_path: Path) -> None:
    text, joints, _ = ARMS["ur5e"]
    (tmp_path / "ur5e.xml").write_text(text, encoding="utf-8")
    arm = arm_of(tmp_path, '<mujoco><include file="ur5e.xml"/></mujoco>', joints)
    refused(arm, tmp_path / "out", "<include> .*write them out")


def test_two_joints_of_one_body_are_refused(tmp_path: Path) -> None:
    arm = arm_of(tmp_path, GEN3, ARMS["gen3"][1])
    refused(arm, tmp_path / "out", "body tool has 2 joints.*a body of its own")


def test_a_coupled_transmission_is_refused(tmp_path: Path) -> None:
    arm = two_joints(tmp_path, ARM2)
    robot = {"mjcf": tmp_path / "arm.xml", "joints": ["joint_1", "joint_2"]}
    robot["couplings"] = [{"joints": ["joint_1", "joint_2"]}]
    configuration = Configuration.model_validate({"robot": robot})
    coupled = case(tmp_path, configuration, change=0.0)
    refused(replace(arm, configuration=coupled.configuration), tmp_path / "out", "robot.couplings: the coupled")  # fmt: skip


def test_bodies_in_frames_and_lines_of_windows(tmp_path: Path) -> None:
    """A <frame> turns what is in it; values belong to the body, and new lines end as the others."""
    text = ARM2.replace(
        '<body name="link_2"', '<frame pos="0.1 0 0" euler="0.3 0 0"><body name="link_2"'
    )
    text = text.replace("</body>\n    </body>", "</body></frame>\n    </body>")
    text = text.replace('<joint name="joint_1"', '<frame euler="0 0 0.2"><joint name="joint_1"')
    text = text.replace('actuatorfrcrange="-90 90"/>', 'actuatorfrcrange="-90 90"/></frame>')
    text = re.sub(r'<inertial pos="0.15[^>]*>', '<geom size="0.1"/>', text)
    text = text.replace("\n", "\r\n")
    arm = two_joints(tmp_path, text)
    content = arm.export(tmp_path / "out").mjcf.read_bytes()
    assert content.count(b"\n") == content.count(b"\r\n")
    assert_same_torques(arm, content.decode(), text)


def test_dry_friction_turns_as_early_as_in_the_recording(tmp_path: Path) -> None:
    text, joints, _ = ARMS["ur5e"]
    leads = {joints[1]: 0.0095, joints[2]: 0.00475}  # MuJoCo's default, and half of it
    arm = arm_of(tmp_path, text, joints).with_gap(friction_leads=leads)
    model = simulator(arm.export(tmp_path / "out").mjcf.read_text(encoding="utf-8"))
    constants = [2.0 * model.opt.timestep, 0.02, 0.01]
    np.testing.assert_allclose(model.dof_solref[:, 0], constants)
    np.testing.assert_allclose(model.dof_solimp[:, 0], [0.99, 0.9, 0.9])
