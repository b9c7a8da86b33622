"""Which ten numbers may be a payload: near the flange, and of a rigid body."""

from collections.abc import Mapping

import numpy as np
import pinocchio as pin
import pytest

from bags.simulated_arms import arm2
from idim_iv_ros.effects.parametric_effect import Change, Estimated, ParameterSpace
from idim_iv_ros.effects.payload import Payload
from idim_iv_ros.model import build_inverse_model

_INERTIA = ("xx", "xy", "yy", "xz", "yz", "zz")
_PLACES = ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))


@pytest.fixture(scope="module")
def space() -> ParameterSpace:
    configuration = arm2(seconds=2.0).configuration
    urdf = configuration.robot.urdf
    assert urdf is not None
    model = build_inverse_model(configuration, urdf.read_text(encoding="utf-8"), urdf.name)
    return ParameterSpace(model, model.given, np.eye(3)[:2])


def body(mass: float, centre: tuple[float, float, float]) -> dict[str, float]:
    """The ten numbers of a box of 0.1 × 0.2 × 0.3 m about the link's frame, by pinocchio."""
    box = pin.Inertia.FromBox(mass, 0.1, 0.2, 0.3)
    moved = pin.Inertia(mass, np.array(centre), box.inertia)
    about = moved.toDynamicParameters()[4:]
    matrix = np.array([[about[0], about[1], about[3]], [about[1], about[2], about[4]],
                       [about[3], about[4], about[5]]])  # fmt: skip
    numbers = {"mass": mass}
    numbers |= {f"moment_{axis}": mass * value for axis, value in zip("xyz", centre, strict=True)}
    return numbers | {
        f"inertia_{name}": float(matrix[place])
        for name, place in zip(_INERTIA, _PLACES, strict=True)
    }


def allowed(
    space: ParameterSpace, numbers: Mapping[str, float], std: float = 1e-4, unknown: str = ""
) -> bool:
    none = np.zeros(space.size)
    estimates = [
        Estimated(Change(name, "", none), value, None if name == unknown else std)
        for name, value in numbers.items()
    ]
    return Payload().admissible(space, space.joints - 1, estimates)


@pytest.mark.parametrize("centre", [(0.0, 0.0, 0.0), (0.1, -0.05, 0.2), (0.3, 0.0, 0.0)])
def test_bodies_are_allowed(space: ParameterSpace, centre: tuple[float, float, float]) -> None:
    assert allowed(space, body(1.5, centre))


def test_a_centre_beyond_the_size_of_the_arm_is_none(space: ParameterSpace) -> None:
    far = body(0.5, (20.0, 0.0, 0.0))
    assert not allowed(space, far)
    point = {name: far[name] for name in ("mass", "moment_x", "moment_y", "moment_z")}
    assert not allowed(space, point)
    assert allowed(space, point, std=4.0)  # it may be near: so wide is the interval


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("inertia_xx", 1.0),  # more than the other two together
        ("inertia_xy", 0.5),  # more than its products allow
        ("moment_x", 0.8),  # the inertia about the frame is too small for it
    ],
)
def test_numbers_that_no_body_has_are_none(space: ParameterSpace, name: str, value: float) -> None:
    numbers = body(1.5, (0.05, 0.0, 0.1)) | {name: value}
    assert not allowed(space, numbers)
    assert allowed(space, numbers, std=1.0)


def test_a_part_that_is_not_there_is_a_body_with_the_other_sign(space: ParameterSpace) -> None:
    joint = space.joints - 1
    there = space.model.robot.given.inertial[joint]
    assert there[0] > 0.2
    part = {name: -value for name, value in body(0.2, (0.05, 0.0, 0.02)).items()}
    point = {name: part[name] for name in ("mass", "moment_x", "moment_y", "moment_z")}
    assert allowed(space, point)
    assert not allowed(space, point | {"moment_x": 5.0})
