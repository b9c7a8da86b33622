"""Inertias and joints that no robot has are refused; those that are only strange are told."""

from pathlib import Path

import pytest

from idim_iv_ros.errors import UsageError
from idim_iv_ros.model import load_robot
from idim_iv_ros.model.urdf import MOVABLE, judge_urdf
from idim_iv_ros.model.urdf_reader import read_urdf_text
from tests.model.test_regressor import arm

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


def refused(urdf: str, *words: str) -> None:
    with pytest.raises(UsageError) as caught:
        load_robot(urdf, ["j1", "j2", "j3"], source="arm.urdf")
    message = str(caught.value)
    assert message.startswith("arm.urdf: ")
    assert "\n" not in message
    for word in words:
        assert word in message, message


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
