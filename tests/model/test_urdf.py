"""URDFs as they come: names of every kind, and files that are none."""

import re
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from idim_iv_ros.configuration import Configuration
from idim_iv_ros.errors import UsageError
from idim_iv_ros.excitation.limits import moving_frames
from idim_iv_ros.model import build_inverse_model, load_robot
from idim_iv_ros.model.urdf import MOVABLE, judge_urdf, read_urdf_text
from idim_iv_ros.simulation import inverse_dynamics
from tests.model.test_regressor import arm, states

GRIPPER = (
    '<joint name="l3" type="fixed"><parent link="l3"/><child link="finger"/>'
    '<origin xyz="0.1 0 0.05" rpy="0.3 0 0.1"/></joint>'
    '<link name="finger"><inertial><origin xyz="0.02 0 0" rpy="0.1 0.2 0.3"/><mass value="0.4"/>'
    '<inertia ixx="0.001" ixy="0" ixz="0" iyy="0.002" iyz="0" izz="0.0015"/></inertial></link>'
)


def with_gripper() -> str:
    """The arm, with a part whose fixed joint has the name of the link that it hangs on."""
    return arm().replace("</robot>", GRIPPER + "</robot>")


def renamed(**names: str) -> str:
    """The arm with its links and joints renamed."""
    urdf = with_gripper()
    for old, new in names.items():
        urdf = urdf.replace(f'"{old}"', f'"{new}"')
    return urdf


def reference_torque(urdf: str, joints: list[str], state: tuple[np.ndarray, ...]) -> np.ndarray:
    """Torque by pinocchio's own reading of the URDF, other joints locked; names must differ."""
    full = pin.buildModelFromXML(urdf)
    kept = [full.getJointId(joint) for joint in joints]
    locked = [index for index in range(1, full.njoints) if index not in kept]
    model = pin.buildReducedModel(full, locked, pin.neutral(full))
    order = [joints.index(name) for name in model.names[1:]]
    torque = np.empty(state[0].shape)
    data = model.createData()
    for sample, values in enumerate(zip(*state, strict=True)):
        torque[sample, order] = pin.rnea(model, data, *(value[order] for value in values))
    return torque


@pytest.mark.parametrize("joints", [["j1", "j2", "j3"], ["j3", "j1"], ["j2"]])
def test_torque_is_that_of_pinocchios_own_reading_of_the_file(joints) -> None:
    urdf = with_gripper().replace("continuous", "revolute")
    state = states(len(joints))
    robot = load_robot(urdf, joints)
    still = [np.zeros(len(joints))] * 4
    bodies = robot.given.__class__(
        robot.given.inertial, *still, robot.given.coupling_joints, *[np.zeros(0)] * 3
    )
    unique = urdf.replace('<joint name="l3"', '<joint name="flange"')
    torque = inverse_dynamics(robot, bodies, *state)
    np.testing.assert_allclose(torque, reference_torque(unique, joints, state), atol=1e-12)


@pytest.mark.parametrize(
    "names",
    [
        {"j2": "l2"},
        {"j3": "finger"},
        {"base": "universe"},
        {"base": "root_joint", "l1": "universe"},
        {"j1": "Gelenk_ä", "l1": "関節"},
        {"j1": "1", "j2": "2", "l1": "1", "l2": "2"},
    ],
    ids=str,
)
def test_names_of_links_and_joints_do_not_change_the_robot(names) -> None:
    plain = load_robot(with_gripper(), ["j1", "j2", "j3"])
    joints = [names.get(joint, joint) for joint in ("j1", "j2", "j3")]
    configuration = Configuration.model_validate({"robot": {"joints": joints}})
    model = build_inverse_model(configuration, renamed(**names), "odd.urdf")
    assert model.robot.joints == tuple(joints)
    assert model.robot.order.tolist() == plain.order.tolist()
    np.testing.assert_array_equal(model.robot.given.inertial, plain.given.inertial)
    state = states(3)
    np.testing.assert_array_equal(
        inverse_dynamics(model.robot, model.robot.given, *state),
        inverse_dynamics(plain, plain.given, *state),
    )
    assert set(moving_frames(model.robot).names) == {
        names.get(name, name) for name in ("j1", "j2", "j3", "l1", "l2", "l3", "finger")
    }


BOMB = '<!DOCTYPE r [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;">]><robot name="&b;"/>'
LIMIT = '<limit lower="-2" upper="2" effort="10" velocity="3"/>'


def beside_parent(more: str) -> str:
    return re.sub("<dynamics[^>]*>", "", arm()).replace(
        '<parent link="base"/>', f'<parent link="base"/>{more}', 1
    )


def joint(name: str, parent: str, child: str) -> str:
    return (
        f'<joint name="{name}" type="fixed"><parent link="{parent}"/>'
        f'<child link="{child}"/></joint></robot>'
    )


def refused(urdf: str, *words: str) -> None:
    with pytest.raises(UsageError) as caught:
        load_robot(urdf, ["j1", "j2", "j3"], source="arm.urdf")
    message = str(caught.value)
    assert message.startswith("arm.urdf: ")
    assert "\n" not in message and len(message) < 500
    for word in words:
        assert word in message, message


@pytest.mark.parametrize(
    ("urdf", "words"),
    [
        ("", "is empty"),
        ("\x00\x01", "not XML"),
        (BOMB, "XML entities"),
        ('<mujoco model="m"/>', "root element is <mujoco>"),
        ('<robot name="r"/>', "no <link>"),
        (arm().replace("</robot>", '<link name="lone"/></robot>'), "2 links are no joint's child"),
        (arm().replace("</robot>", joint("back", "l3", "base")), "loop through base, l1"),
        (arm().replace("</robot>", joint("more", "l1", "l3")), "l3 is the child of two joints"),
        (arm().replace('link="base"', 'link="gone"'), "parent link gone is not in the file"),
        (arm().replace('<parent link="base"/>', ""), "joint j1: names no parent link"),
        (arm().replace('type="prismatic"', 'type="hinge"'), "joint j2: unknown type hinge"),
        (arm().replace('name="j2"', 'name="j1"'), "two joints are named j1"),
        (arm().replace('<link name="l2"', '<link name="l1"'), "two links are named l1"),
        (arm().replace('xyz="0.2 -0.1 0.2"', 'xyz="0.2 nan 0.2"'), "joint j2 <origin>: xyz is nan"),
        (arm().replace('xyz="0.2 -0.1 0.2"', 'xyz="0.2 0.2"'), "xyz has 2 numbers, not 3"),
        (arm().replace('rpy="0.2 0.3 -0.2"', 'rpy="${pi} 0 0"'), "expand the xacro"),
        (arm().replace('lower="-2"', 'lower="nan"', 1), "joint j1: <limit> lower is nan"),
        (arm().replace('mass value="2.0"', 'mass value="1e300"'), "link l1: <mass> value is 1e300"),
        (arm().replace('<mass value="2.0"/>', ""), "link l1: <inertial> has no <mass>"),
        (arm().replace('ixx="0.02" ', "", 1), "link l1: <inertia> has no ixx"),
        (arm().replace("</inertial>", "</inertial><inertial/>", 1), "link l1 has 2 <inertial>"),
        (beside_parent('<dynamics damping="1"/>' * 2), "joint j1 has 2 <dynamics>"),
        (beside_parent('<mimic joint="j2"/>'), "joint j1 is made to follow j2 by <mimic>"),
    ],
)  # fmt: skip
def test_a_file_that_is_no_robot_is_one_line_that_says_why(urdf: str, words: str) -> None:
    refused(urdf, words)


def test_all_problems_are_in_one_line_and_many_are_counted() -> None:
    with pytest.raises(UsageError) as caught:
        load_robot(arm().replace('ixx="0.02"', 'ixx="x"'), ["j1"], source="a.urdf")
    assert str(caught.value).count("ixx is x, not a number") == 3
    many = arm()
    for number in ("0.02", "0.001", "-0.002"):
        many = many.replace(f'="{number}"', '="x"')
    with pytest.raises(UsageError, match="and 5 more"):
        load_robot(many, ["j1"])


def test_joints_without_limits_are_unlimited_and_said() -> None:
    robot = load_robot(arm().replace(LIMIT, "", 1), ["j1"], source="arm.urdf")
    assert np.isinf(robot.limits.upper[0])
    assert robot.doubts == ("arm.urdf: joint j1: no <limit>: taken as unlimited",)


def test_continuous_joint_has_one_coordinate_and_no_position_limit() -> None:
    robot = load_robot(arm(), ["j1", "j2", "j3"])
    assert robot.pinocchio.nq == 3
    assert np.isinf(robot.limits.upper[2])
    assert robot.limits.effort[2] == 10.0


def test_a_joint_that_is_missing_or_fixed_is_refused_by_name() -> None:
    with pytest.raises(UsageError, match=r"no joint elbow .* j1, j2, j3"):
        load_robot(arm(), ["elbow"])
    with pytest.raises(UsageError, match="j2 is fixed"):
        load_robot(arm(("revolute", "fixed")), ["j2"])


CONFIG = Path(__file__).parents[2] / "config"
MOMENTS = '<inertia ixx="0.02" ixy="0.001" ixz="-0.002" iyy="0.03" iyz="0.003" izz="0.025"/>'


def link(moments: tuple[str, ...], mass: str = "2.0", centre: str = "0.05 0.01 -0.1") -> str:
    """The arm with another first link: ixx, iyy, izz and, where given, ixy, ixz, iyz."""
    keys = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
    values = (*moments, "0", "0", "0")[:6]
    inertia = " ".join(f'{key}="{value}"' for key, value in zip(keys, values, strict=True))
    urdf = arm().replace(MOMENTS, f"<inertia {inertia}/>", 1)
    return urdf.replace('mass value="2.0"', f'mass value="{mass}"').replace(
        'origin xyz="0.05 0.01 -0.1"', f'origin xyz="{centre}"'
    )


def doubts(urdf: str) -> str:
    return "\n".join(load_robot(urdf, ["j1", "j2", "j3"], source="arm.urdf").doubts)


@pytest.mark.parametrize(
    "moments",
    [
        ("0.26", "0.13", "0.12"),  # 0.255, 0.131, 0.124 in three digits
        ("0.2512", "0.1307", "0.1195"),  # by 0.4 % of the trace
        ("0.0", "0.01", "0.0100001"),  # a thin rod
    ],
)
def test_inertia_that_rounding_may_have_made_is_a_doubt(moments) -> None:
    assert "link l1: principal moments" in doubts(link(moments))


@pytest.mark.parametrize(
    ("urdf", "words"),
    [
        (link(("0.02", "0.03", "0.025"), "0"), "without a mass"),
        (link(("1000", "1000", "1000"), "1"), "radius of gyration of 38.7 m"),
        (link(("0.02", "0.03", "0.025"), centre="40 0 0"), "centre of mass 40 m from its joint"),
        (link(("0.02", "0.03", "0.025"), "20000"), "a mass of 20000 kg"),
        (arm().replace('velocity="3"', 'velocity="0"', 1), "joint j1: velocity limit of zero"),
        (arm().replace('lower="-2" upper="2"', "", 1), "joint j1: position limit of zero"),
    ],
)
def test_what_is_only_strange_is_a_doubt_by_link_and_value(urdf: str, words: str) -> None:
    assert words in doubts(urdf)


SOUND = ("0.02", "0.03", "0.025")
INDEFINITE = ("link l1: principal moments", "negative")
TRIANGLE = ("link l1: principal moments", "triangle inequality", "kg m²")


@pytest.mark.parametrize(
    ("urdf", "words"),
    [
        *((link(SOUND, mass), ("link l1", mass)) for mass in ("-1", "nan", "inf")),
        (link(("-0.02", "0.03", "0.025")), INDEFINITE),
        (link(("0.02", "0.03", "0.025", "0.1")), INDEFINITE),  # by its product
        (link(("-0.48", "0.0", "1.09")), INDEFINITE),  # XX2 of a table of base parameters
        (link(("0.1", "0.01", "0.01")), TRIANGLE),
        (link(("0.30000", "0.10000", "0.18000")), TRIANGLE),
        (arm().replace('axis xyz="0 0 1"', 'axis xyz="0 0 0"'), ("joint j1: its axis is zero",)),
        (arm().replace('lower="-2"', 'lower="2.5"', 1), ("limit 2.5 is above upper limit 2",)),
        (arm().replace('effort="10"', 'effort="-10"', 1), ("effort limit -10 N m is negative",)),
        (arm().replace('velocity="3"', 'velocity="-3"', 1), ("limit -3 rad/s is negative",)),
        (arm().replace('damping="0.5"', 'damping="-0.5"'), ("damping -0.5 is negative",)),
    ],
)
def test_link_or_joint_that_cannot_be_is_refused_by_name_and_value(urdf, words) -> None:
    refused(urdf, *words)


@pytest.mark.parametrize("path", sorted(CONFIG.glob("*.urdf")), ids=lambda path: path.stem)
def test_shipped_robots_are_beyond_doubt(path: Path) -> None:
    urdf = read_urdf_text(path.read_text(), path.name)
    joints = [name for name, joint in urdf.joints.items() if joint.type in MOVABLE]
    assert judge_urdf(urdf, joints) == ([], [])
