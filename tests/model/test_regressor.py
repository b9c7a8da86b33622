"""The regressor against pinocchio's own inverse dynamics, which does not use it."""

import numpy as np
import pinocchio as pin
import pytest

from idim_iv_ros.model import StandardRegressor, find_base_parameters, load_robot, parameter_layout
from idim_iv_ros.model.link_motion import skeleton
from idim_iv_ros.model.parameters import unit_at

LINK = (
    '<link name="{name}"><inertial><mass value="{mass}"/><origin xyz="{com}"/>'
    '<inertia ixx="{ixx}" ixy="0.001" ixz="-0.002" iyy="{iyy}" iyz="0.003" izz="{izz}"/>'
    "</inertial></link>"
)
JOINT = (
    '<joint name="{name}" type="{type}"><parent link="{parent}"/><child link="{child}"/>'
    '<origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="{axis}"/>'
    '<limit lower="-2" upper="2" effort="10" velocity="3"/>'
    '<dynamics damping="{damping}" friction="{friction}"/></joint>'
)


def arm(types: tuple[str, ...] = ("revolute", "prismatic", "continuous")) -> str:
    parts = ['<robot name="arm"><link name="base"/>']
    for k, joint_type in enumerate(types, start=1):
        axis = ("0 0 1", "0 1 0", "0.6 0 0.8")[(k - 1) % 3]
        parts.append(
            JOINT.format(
                name=f"j{k}",
                type=joint_type,
                parent="base" if k == 1 else f"l{k - 1}",
                child=f"l{k}",
                xyz=f"0.{k} -0.1 0.2",
                rpy=f"0.{k} 0.3 -0.2",
                axis=axis,
                damping=0.5 * k,
                friction=0.1 * k,
            )
        )
        parts.append(
            LINK.format(
                name=f"l{k}", mass=1.0 + k, com=f"0.05 0.0{k} -0.1", ixx=0.02, iyy=0.03, izz=0.025
            )
        )
    return "".join(parts) + "</robot>"


def states(joints: int, samples: int = 20) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    random = np.random.default_rng(3)
    shape = (samples, joints)
    return random.uniform(-2, 2, shape), random.normal(size=shape), random.normal(size=shape)


def rnea(model: pin.Model, q: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> np.ndarray:
    data = model.createData()
    return np.array([pin.rnea(model, data, *state) for state in zip(q, dq, ddq, strict=True)])


@pytest.mark.parametrize("joints", [("j1", "j2", "j3"), ("j3", "j1", "j2"), ("j1", "j3")])
def test_torque_of_the_urdf_inertials_is_that_of_recursive_newton_euler(joints) -> None:
    robot = load_robot(arm(), joints)
    layout = parameter_layout(robot.joint_types, friction=[], drive_inertia=False)
    q, dq, ddq = states(len(joints))
    torque = StandardRegressor(robot, layout)(q, dq, ddq) @ layout.vector(robot.given)
    order = robot.order
    expected = rnea(robot.pinocchio, q[:, order], dq[:, order], ddq[:, order])
    np.testing.assert_allclose(torque[:, order], expected, rtol=1e-11, atol=1e-11)


def test_drives_and_friction_add_their_own_torque() -> None:
    robot = load_robot(arm(), ["j1", "j2", "j3"], armature=[0.1, 0.2, 0.3])
    layout = parameter_layout(
        robot.joint_types, friction=["viscous", "coulomb", "offset"], drive_inertia=True
    )
    q, dq, ddq = states(3)
    vector = layout.vector(robot.given)
    inertial = [p.kind not in ("Ia", "Fv", "Fc", "off") for p in layout.parameters]
    regressor = StandardRegressor(robot, layout)(q, dq, ddq)
    drives = regressor @ np.where(inertial, 0.0, vector)
    damping, friction = np.array([0.5, 1.0, 1.5]), np.array([0.1, 0.2, 0.3])
    armature = np.array([0.1, 0.2, 0.3])
    np.testing.assert_allclose(drives, armature * ddq + damping * dq + friction * np.sign(dq))


def test_coupled_motor_turns_with_both_joints() -> None:
    """Energy of the coupled drive is ½ Ia (dq1 + dq2)²: its torque is the same on both joints."""
    robot = load_robot(arm(), ["j1", "j2", "j3"], couplings=[(0, 1)])
    layout = parameter_layout(
        robot.joint_types, friction=["viscous", "coulomb"], drive_inertia=True, couplings=[(0, 1)]
    )
    q, dq, ddq = states(3)
    regressor = StandardRegressor(robot, layout)(q, dq, ddq)
    names = list(layout.names)
    motor = regressor[:, :, names.index("Ia2")] + 0.0
    motor[:, 0] += ddq[:, 0]  # Ia1 holds what the motor adds to joint 1's own acceleration
    both = ddq[:, 0] + ddq[:, 1]
    np.testing.assert_allclose(motor, np.column_stack([both, both, 0 * both]))
    coulomb = regressor[:, :, names.index("Fcm2")]
    sign = np.sign(dq[:, 0] + dq[:, 1])
    np.testing.assert_allclose(coulomb, np.column_stack([sign, sign, 0 * sign]))


@pytest.mark.parametrize(
    ("unit", "joint_type", "effort_unit", "expected"),
    [
        ("N m s/rad", "revolute", "N m", "N m s/rad"),
        ("N m s/rad", "prismatic", "N m", "N s/m"),
        ("kg m²", "prismatic", "N m", "kg"),
        ("mrad", "prismatic", "N m", "mm"),
        ("rad/s", "prismatic", "A", "m/s"),
        ("N m", "revolute", "A", "A"),
        ("kg m²", "revolute", "V", "V s²/rad"),
        ("kg m²", "prismatic", "A", "A s²/m"),
        ("0.3 rad of gradient", "prismatic", "N m", "0.3 m of gradient"),
    ],
)
def test_a_unit_follows_the_joint_and_its_effort(unit, joint_type, effort_unit, expected) -> None:
    assert unit_at(unit, joint_type, effort_unit) == expected


URDF = """<robot name="r">
<link name="base"/><link name="upper"/><link name="lower"/><link name="tip"/>
<joint name="a" type="continuous"><parent link="base"/><child link="upper"/>
  <origin xyz="0 0 0.5"/><axis xyz="0 0 1"/></joint>
<joint name="b" type="continuous"><parent link="upper"/><child link="lower"/>
  <origin xyz="1 0 0"/><axis xyz="0 0 1"/></joint>
<joint name="c" type="fixed"><parent link="lower"/><child link="tip"/>
  <origin xyz="0.8 0 0"/></joint>
</robot>"""


@pytest.mark.parametrize("order", [("a", "b"), ("b", "a")])
def test_joints_of_a_planar_arm_are_where_trigonometry_puts_them(order: tuple[str, str]) -> None:
    drawn = skeleton(load_robot(URDF, order))
    first, second = order.index("a"), order.index("b")
    # Joints without limits are bent by 0.6 rad, every other one the other way.
    one, two = (0.6, -0.6) if first == 0 else (-0.6, 0.6)
    np.testing.assert_allclose(drawn.origins[first], [0.0, 0.0, 0.5], atol=1e-12)
    np.testing.assert_allclose(drawn.origins[second], [np.cos(one), np.sin(one), 0.5], atol=1e-12)
    np.testing.assert_allclose(drawn.axes, [[0.0, 0.0, 1.0]] * 2, atol=1e-12)
    assert drawn.parents[first] == -1
    assert drawn.parents[second] == first
    assert (drawn.links[first], drawn.links[second]) == ("upper", "lower")
    ((joint, end),) = drawn.ends
    assert joint == second
    reach = drawn.origins[second] + 0.8 * np.array([np.cos(one + two), np.sin(one + two), 0.0])
    np.testing.assert_allclose(end, reach, atol=1e-12)
    assert len(drawn.segments) == 3


def test_limits_set_the_middle_and_a_slide_is_not_bent() -> None:
    limited = (
        '<joint name="b" type="prismatic"><limit lower="0.2" upper="0.6" effort="1" velocity="1"/>'
    )
    before, second = URDF.split('<joint name="b" type="continuous">')
    urdf = before + limited + second.replace('xyz="0 0 1"', 'xyz="1 0 0"', 1)
    drawn = skeleton(load_robot(urdf, ("a", "b")))
    assert np.linalg.norm(drawn.origins[1] - drawn.origins[0]) == pytest.approx(1.4)


PLANAR = """
<robot name="planar"><link name="base"/>
<joint name="j1" type="revolute"><parent link="base"/><child link="l1"/>
<origin rpy="1.5708 0 0"/><axis xyz="0 0 1"/><limit lower="-3" upper="3" effort="1" velocity="1"/>
</joint><link name="l1"><inertial><mass value="1"/><origin xyz="0.2 0 0"/>
<inertia ixx="0.01" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="j2" type="revolute"><parent link="l1"/><child link="l2"/><origin xyz="0.5 0 0"/>
<axis xyz="0 0 1"/><limit lower="-3" upper="3" effort="1" velocity="1"/></joint>
<link name="l2"><inertial><mass value="1"/><origin xyz="0.1 0 0"/>
<inertia ixx="0.01" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link></robot>
"""


def regressor_of(urdf: str, joints: list[str], *, drives: bool = True) -> StandardRegressor:
    robot = load_robot(urdf, joints)
    friction = ["viscous", "coulomb", "offset"] if drives else []
    layout = parameter_layout(robot.joint_types, friction=friction, drive_inertia=drives)
    return StandardRegressor(robot, layout)


def test_vertical_planar_arm_has_the_textbook_base_set() -> None:
    """Two-link planar arm in a vertical plane (Khalil and Dombre, Modeling, chapter 9)."""
    base = find_base_parameters(regressor_of(PLANAR, ["j1", "j2"], drives=False))
    assert base.expressions == ("ZZ1 + 0.25 M2", "MX1 + 0.5 M2", "MY1", "ZZ2", "MX2", "MY2")


def test_base_parameters_give_the_torque_of_the_standard_parameters() -> None:
    regressor = regressor_of(arm(), ["j1", "j2", "j3"])
    base = find_base_parameters(regressor)
    standard = np.random.default_rng(0).normal(size=len(regressor.layout.parameters))
    matrix = regressor(*states(3, 200))
    torque = matrix[:, :, base.columns] @ base.from_standard(standard)
    np.testing.assert_allclose(torque, matrix @ standard, atol=1e-7)
    np.testing.assert_allclose(matrix @ base.to_standard(base.from_standard(standard)), torque)


@pytest.mark.parametrize("joints", [6, 24])
def test_as_many_columns_are_kept_as_are_independent_at_other_states(joints: int) -> None:
    """The rank is by singular values."""
    regressor = regressor_of(chain(joints), [f"j{joint}" for joint in range(joints)])
    base = find_base_parameters(regressor)
    seen = regressor(*states(joints, 200)).reshape(-1, 14 * joints)
    norms = np.linalg.norm(seen, axis=0)
    shown = norms > 1e-9
    assert len(base.columns) == np.linalg.matrix_rank(seen[:, shown] / norms[shown])


def chain(joints: int) -> str:
    """URDF of a serial arm whose axes turn by right angles."""
    links, tree = ['<link name="l-1"/>'], []
    for joint in range(joints):
        axis = ("0 0 1", "0 1 0", "1 0 0")[joint % 3]
        links.append(
            f'<link name="l{joint}"><inertial><origin xyz="0.05 0.01 0.02"/><mass value="1"/>'
            '<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>'
        )
        tree.append(
            f'<joint name="j{joint}" type="revolute"><parent link="l{joint - 1}"/>'
            f'<child link="l{joint}"/><origin xyz="0.1 0 0"/><axis xyz="{axis}"/>'
            '<limit lower="-3" upper="3" effort="1" velocity="1"/></joint>'
        )
    return f'<robot name="chain">{"".join(links + tree)}</robot>'
