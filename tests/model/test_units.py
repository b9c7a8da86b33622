import pytest

from idim_iv_ros.model.parameters import unit_at


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
