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
    assert base.expressions == (
        "ZZ1 + 0.25 M2",
        "MX1 + 0.5 M2",
        "MY1",
        "ZZ2",
        "MX2",
        "MY2",
    )


def test_base_parameters_give_the_torque_of_the_standard_parameters() -> None:
    regressor = regressor_of(arm(), ["j1", "j2", "j3"])
    base = find_base_parameters(regressor)
    standard = np.random.default_rng(0).normal(size=len(regressor.layout.parameters))
    matrix = regressor(*states(3, 200))
    torque = matrix[:, :, base.columns] @ base.from_standard(standard)
    np.testing.assert_allclose(torque, matrix @ standard, atol=1e-7)
    np.testing.assert_allclose(matrix @ base.to_standard(base.from_standard(standard)), torque)


def test_base_set_is_minimal() -> None:
    regressor = regressor_of(arm(), ["j1", "j2", "j3"])
    base = find_base_parameters(regressor)
    matrix = regressor(*states(3, 300))
    full = matrix.reshape(-1, matrix.shape[2])
    assert np.linalg.matrix_rank(full, tol=1e-8 * np.linalg.norm(full)) == len(base.columns)


def test_torque_depends_only_on_active_parameters() -> None:
    regressor = regressor_of(arm(), ["j1", "j2", "j3"])
    base = find_base_parameters(regressor)
    matrix = regressor(*states(3, 100))[:, :, base.columns]
    silent = np.abs(matrix).max(axis=0) < 1e-9
    np.testing.assert_array_equal(silent, ~base.active)


@pytest.mark.parametrize("tolerance", [1e-8, 1e-5])
def test_base_set_does_not_hang_on_the_tolerance(tolerance: float) -> None:
    regressor = regressor_of(arm(), ["j1", "j2", "j3"])
    assert find_base_parameters(regressor, tolerance).names == find_base_parameters(regressor).names
