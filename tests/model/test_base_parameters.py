"""The base set: the same dynamics with the fewest parameters."""

import numpy as np
import pytest

from idim_iv_ros.model import StandardRegressor, find_base_parameters, load_robot, parameter_layout
from tests.model.test_regressor import arm, states

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
