import numpy as np
import pytest

from idim_iv_ros.model import load_robot
from idim_iv_ros.model.skeleton import skeleton

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
