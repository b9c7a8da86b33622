"""URDF as users have it, and what is refused."""

import numpy as np
import pytest

from idim_iv_ros.errors import UsageError
from idim_iv_ros.model import load_robot
from tests.model.test_regressor import arm


def test_other_joints_are_locked() -> None:
    robot = load_robot(arm(), ["j2"])
    assert robot.pinocchio.nv == 1
    assert robot.joint_types == ("prismatic",)


def test_continuous_joint_has_one_coordinate_and_no_position_limit() -> None:
    robot = load_robot(arm(), ["j1", "j2", "j3"])
    assert robot.pinocchio.nq == 3
    assert np.isinf(robot.limits.upper[2])
    assert robot.limits.effort[2] == 10.0


def test_rounded_right_angles_are_right_angles() -> None:
    urdf = arm(("revolute", "revolute")).replace('rpy="0.2 0.3 -0.2"', 'rpy="1.5708 0 -1.5708"')
    rotation = load_robot(urdf, ["j1", "j2"]).pinocchio.jointPlacements[2].rotation
    np.testing.assert_allclose(np.abs(rotation), np.round(np.abs(rotation)), atol=1e-15)


@pytest.mark.parametrize(
    ("urdf", "joints", "words"),
    [
        (arm(), ["elbow"], "no joint elbow .* j1, j2, j3"),
        (arm(("revolute", "fixed")), ["j2"], "j2 is fixed"),
    ],
)
def test_unusable_urdf_is_one_line_that_names_the_file(urdf, joints, words) -> None:
    with pytest.raises(UsageError, match=words) as caught:
        load_robot(urdf, joints, source="arm.urdf")
    assert "\n" not in str(caught.value)
    assert str(caught.value).startswith("arm.urdf")
