"""MJCF files against MuJoCo's own inverse dynamics, and against the same arm as a URDF."""

# ruff: noqa: E501  # lines of MJCF

from pathlib import Path

import mujoco
import numpy as np
import pytest

from idim_iv_ros.errors import UsageError
from idim_iv_ros.model import (
    RobotModel,
    StandardRegressor,
    load_robot,
    parameter_layout,
    read_urdf_file,
)
from idim_iv_ros.model.mjcf import mjcf_as_urdf
from idim_iv_ros.model.urdf import description_key
from tests.model.mjcf_robots import ARMS, XARM7

CONFIG = Path(__file__).resolve().parents[2] / "config"
ARM2 = """<mujoco model="arm2">
  <compiler angle="radian"/>
  <default><default class="arm"><joint axis="0 1 0" armature="0.25"/></default></default>
  <worldbody>
    <body name="link_1" pos="0 0 0.6" childclass="arm">
      <inertial pos="0.19 0.01 0.004" mass="4.2" fullinertia="0.0042525 0.0581263 0.0581263 0 0.0009 0"/>
      <joint name="joint_1" limited="true" range="-2.8 2.8" damping="1.1" frictionloss="1.8"
        actuatorfrclimited="true" actuatorfrcrange="-90 90"/>
      <body name="link_2" pos="0.42 0 0">
        <inertial pos="0.15 -0.008 0.003" mass="2.3" fullinertia="0.00140875 0.022861 0.022861 0 -0.0005 0"/>
        <joint name="joint_2" limited="true" range="-2.6 2.6" damping="0.5" frictionloss="0.9"
          armature="0.1" actuatorfrclimited="true" actuatorfrcrange="-35 35"/>
      </body>
    </body>
  </worldbody>
</mujoco>"""


def written(folder: Path, text: str, name: str = "arm.xml") -> Path:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def torques(robot: RobotModel, q: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> np.ndarray:
    """The regressor times the given values."""
    layout = parameter_layout(
        robot.joint_types, friction=("viscous", "coulomb", "offset"), drive_inertia=True
    )
    return StandardRegressor(robot, layout)(q, dq, ddq) @ layout.vector(robot.given)


def simulator(text: str) -> mujoco.MjModel:
    """The file as MuJoCo has it, without drawings, whose files are missing."""
    spec = mujoco.MjSpec.from_string(text)
    for geom in list(spec.geoms):
        if geom.type == mujoco.mjtGeom.mjGEOM_MESH:
            spec.delete(geom)
    for mesh in list(spec.meshes):
        spec.delete(mesh)
    return spec.compile()


@pytest.mark.parametrize("name", ARMS)
def test_the_regressor_equals_the_inverse_dynamics_of_mujoco(name: str, tmp_path: Path) -> None:
    text, joints, locked = ARMS[name]
    path = written(tmp_path, text)
    robot = load_robot(read_urdf_file(path), joints, source=path.name)
    model = simulator(text)
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_SPRING
    data = mujoco.MjData(model)
    start = model.key_qpos[0] if model.nkey else model.qpos0
    place = [model.joint(joint).qposadr[0] for joint in joints]
    dofs = [model.joint(joint).dofadr[0] for joint in joints]
    random = np.random.default_rng(4)
    shape = (20, len(joints))
    q, dq, ddq = random.uniform(-2, 2, shape), random.normal(size=shape), random.normal(size=shape)
    expected = np.zeros(shape)
    for k in range(20):
        data.qpos[:] = start
        data.qpos[place], data.qvel[:], data.qacc[:] = q[k], 0.0, 0.0
        data.qvel[dofs], data.qacc[dofs] = dq[k], ddq[k]
        mujoco.mj_inverse(model, data)
        # Dry friction is a constraint of MuJoCo, switched off here; its law is Coulomb's.
        friction = model.dof_frictionloss[dofs] * np.sign(dq[k])
        expected[k] = data.qfrc_inverse[dofs] + friction
    assert torques(robot, q, dq, ddq) == pytest.approx(expected, rel=1e-10, abs=1e-10)
    assert robot.armature_given
    for joint in locked:
        assert any(joint in doubt and "locked at" in doubt for doubt in robot.doubts), robot.doubts


def test_the_same_arm_as_urdf_and_mjcf_has_the_same_regressor(tmp_path: Path) -> None:
    joints = ("joint_1", "joint_2")
    urdf = load_robot(read_urdf_file(CONFIG / "arm2.urdf"), joints, armature=(0.25, 0.1))
    mjcf = load_robot(read_urdf_file(written(tmp_path, ARM2)), joints)
    layout = parameter_layout(mjcf.joint_types, friction=("viscous", "coulomb"), drive_inertia=True)
    states = np.random.default_rng(5).uniform(-2, 2, (3, 50, 2))
    matrices = [StandardRegressor(robot, layout)(*states) for robot in (urdf, mjcf)]
    assert np.abs(matrices[0] - matrices[1]).max() < 1e-10
    assert layout.vector(mjcf.given) == pytest.approx(layout.vector(urdf.given), abs=1e-10)
    for key in ("lower", "upper", "effort"):
        assert getattr(mjcf.limits, key) == pytest.approx(getattr(urdf.limits, key))
    given = load_robot(read_urdf_file(tmp_path / "arm.xml"), joints, armature=(0.3, 0.2)).given
    assert list(given.drive_inertia) == [0.3, 0.2]


def test_files_that_it_includes_are_read(tmp_path: Path) -> None:
    written(tmp_path, XARM7, "xarm7.xml")
    scene = '<mujoco><include file="xarm7.xml"/><worldbody><geom type="plane" size="1 1 1"/></worldbody></mujoco>'
    path = written(tmp_path, scene, "scene.xml")
    robot = load_robot(read_urdf_file(path), ARMS["xarm7"][1])
    assert list(robot.limits.effort) == [50.0, 50.0]
    assert description_key(path) == "mjcf" and description_key(CONFIG / "arm2.urdf") == "urdf"


SPRING = ARM2.replace('frictionloss="0.9"', 'frictionloss="0.9" stiffness="3"')
BALL = ARM2.replace(
    '<body name="link_2"',
    '<body name="pan"><joint name="wrist" type="ball"/><geom size="0.1"/></body><body name="link_2"',
)
MESH = ARM2.replace(
    '<joint name="joint_2"', '<geom type="mesh" mesh="m"/><joint name="joint_2"'
).replace(
    '<inertial pos="0.15 -0.008 0.003" mass="2.3" fullinertia="0.00140875 0.022861 0.022861 0 -0.0005 0"/>',
    "",
)
MESH = MESH.replace("<worldbody>", '<asset><mesh name="m" file="nothing.obj"/></asset><worldbody>')


@pytest.mark.parametrize(
    ("text", "joints", "words"),
    [
        (XARM7, ("joint1", "left_driver_joint"), ("left_driver_joint", "equality", "tendon split")),
        (XARM7, ("joint1", "left_finger_joint"), ("left_finger_joint", "equality")),
        (SPRING, ("joint_1", "joint_2"), ("joint_2", "spring")),
        (BALL, ("wrist", "joint_2"), ("wrist", "ball joint")),
        (MESH, ("joint_1", "joint_2"), ("nothing.obj",)),
        (ARM2, ("joint_1", "elbow"), ("no joint elbow", "joint_1, joint_2")),
        ("<mujoco><worldbody><bodi/></worldbody></mujoco>", ("a",), ("line 1", "bodi")),
    ],
)  # fmt: skip
def test_what_the_nominal_model_cannot_hold_is_refused_in_one_line(text, joints, words, tmp_path):
    path = written(tmp_path, text)
    with pytest.raises(UsageError) as refused:
        load_robot(read_urdf_file(path), joints, source=str(path))
    message = str(refused.value)
    assert all(word in message for word in words), message
    assert "\n" not in message and str(path) in message


def test_without_mujoco_one_line_names_the_extra(tmp_path, monkeypatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "mujoco", None)
    with pytest.raises(UsageError, match=r"idim-iv-ros\[mujoco\]"):
        read_urdf_file(written(tmp_path, ARM2))


def test_gravity_compensation_is_a_doubt_that_the_user_is_shown(tmp_path: Path) -> None:
    text = ARM2.replace('<body name="link_2"', '<body name="link_2" gravcomp="1"')
    robot = load_robot(read_urdf_file(written(tmp_path, text)), ("joint_1", "joint_2"))
    assert any("gravcomp of link_2" in doubt for doubt in robot.doubts)


@pytest.mark.skipif(
    not hasattr(mujoco.MjModel, "actuator_armature"), reason="MuJoCo is older than 3.5"
)
def test_armature_and_damping_of_an_actuator_count_at_its_joint(tmp_path: Path) -> None:
    text = ARM2.replace(
        "</mujoco>",
        '<actuator><motor joint="joint_2" gear="3" armature="0.05" damping="0.07"/></actuator></mujoco>',
    )
    robot = load_robot(read_urdf_file(written(tmp_path, text)), ("joint_1", "joint_2"))
    model = mujoco.MjModel.from_xml_string(text)
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    data = mujoco.MjData(model)
    data.qvel[:], data.qacc[:] = (0.4, -0.7), (1.0, 2.0)
    mujoco.mj_inverse(model, data)
    friction = model.dof_frictionloss * np.sign(data.qvel)
    state = (np.zeros((1, 2)), np.array([[0.4, -0.7]]), np.array([[1.0, 2.0]]))
    assert torques(robot, *state)[0] == pytest.approx(data.qfrc_inverse + friction, rel=1e-10)


@pytest.mark.parametrize(
    ("mass", "words"),
    [
        ("nan", "a number in it is NaN"),
        ("-1", "'link_1', id 1, line 5"),
        ("abc", "attribute 'mass'"),
    ],
)
def test_what_mujoco_says_is_said_in_words_of_the_file(mass, words, tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    text = ARM2.replace('mass="4.2"', f'mass="{mass}"')
    with pytest.raises(UsageError) as caught:
        mjcf_as_urdf(Path("arm.xml"), text)
    assert words in str(caught.value) and "Error" not in str(caught.value)
    assert capfd.readouterr().err == ""
    assert list(tmp_path.iterdir()) == []  # MUJOCO_LOG.TXT
