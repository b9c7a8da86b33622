"""Causes of several robots: what is of the type, and what is of one robot, by sign and size."""

from dataclasses import replace

import pytest

from idim_iv_ros.effects.cause import EffectParameter
from idim_iv_ros.fleet.bag_result import CauseSummary
from idim_iv_ros.fleet.diagnose import gap_summary
from idim_iv_ros.fleet.result import CommonCause
from idim_iv_ros.fleet.statistics.common_causes import common_causes, is_nothing, sentences
from tests.report.sample_gap import sample_gap

ORDINARY = ["robot_1", "robot_2", "robot_3"]


def level(change: float, std: float = 0.005) -> CauseSummary:
    """Friction at joint_2 that is not the nominal one."""
    numbers = {
        "change_of_viscous": EffectParameter(0.001, 0.01, "N m s/rad"),
        "change_of_coulomb": EffectParameter(change, std, "N m"),
    }
    return CauseSummary("friction_level", "parametric", "joint_2", numbers)


def drift(time: tuple[float, float], coulomb: tuple[float, float]) -> CauseSummary:
    """Friction at joint_2 that fades: time constant and Coulomb part, each with its deviation."""
    numbers = {
        "time_constant": EffectParameter(*time, "s"),
        "coulomb": EffectParameter(*coulomb, "N m"),
        "restarts": EffectParameter(0.0, None, ""),
    }
    return CauseSummary("friction_drift", "structural", "joint_2", numbers)


def gain(factor: float) -> CauseSummary:
    """A torque that is recorded with another gain at joint_1."""
    numbers = {"factor": EffectParameter(factor, 0.01, "")}
    return CauseSummary("torque_gain", "parametric", "joint_1", numbers)


def shown(causes: tuple[CommonCause, ...]) -> list[tuple[set[str], bool]]:
    """Robots of each cause, and whether it is one of the type."""
    return [(set(cause.robots), cause.of_type) for cause in causes]


def test_a_robot_with_another_size_stands_apart_from_its_type() -> None:
    sizes = {"robot_1": -0.05, "robot_2": -0.052, "robot_3": -0.047, "robot_4": 0.6}
    causes = common_causes({name: [level(size)] for name, size in sizes.items()}, ORDINARY)
    assert shown(causes) == [(set(ORDINARY), True), ({"robot_4"}, False)]
    usual, apart = (cause.parameters["change_of_coulomb"] for cause in causes)
    assert usual.value == pytest.approx(-0.0497, abs=1e-4)
    assert usual.std == pytest.approx(0.005 / 3**0.5, rel=1e-6)
    assert (apart.value, apart.std) == (0.6, 0.005)
    said = sentences("arm", causes, list(sizes), ORDINARY)
    assert len(said) == 2
    assert "0.6" in said[1] and "-0.05" in said[1] and "alone" not in said[1]


@pytest.mark.parametrize(
    ("sizes", "groups"),
    [
        ((0.5, 0.42, 0.58), [3]),  # robots of a type scatter
        ((0.05, 0.05, -0.05), [2, 1]),
        ((0.05, -0.05, 0.6), [1, 1, 1]),  # none of the type
        ((0.1, 0.1, 0.6), [2, 1]),
    ],
)
def test_robots_have_a_cause_in_common_where_sign_and_size_agree(
    sizes: tuple[float, ...], groups: list[int]
) -> None:
    diagnosed = {name: [level(size)] for name, size in zip(ORDINARY, sizes, strict=True)}
    causes = common_causes(diagnosed, ORDINARY)
    assert [len(cause.robots) for cause in causes] == groups
    assert [cause.of_type for cause in causes] == [count >= 2 for count in groups]


def test_wide_intervals_agree_with_any_size_in_them() -> None:
    diagnosed = {"robot_1": [level(0.1, 0.2)], "robot_2": [level(0.5, 0.1)]}
    assert shown(common_causes(diagnosed, ["robot_1", "robot_2"])) == [
        ({"robot_1", "robot_2"}, True)
    ]


def test_a_gain_is_compared_by_its_distance_from_one() -> None:
    diagnosed = {"robot_1": [gain(1.1)], "robot_2": [gain(0.9)]}
    assert len(common_causes(diagnosed, ["robot_1", "robot_2"])) == 2
    assert is_nothing(gain(1.015)) and not is_nothing(gain(1.1))


def test_a_coupling_in_the_other_direction_is_another_cause() -> None:
    diagnosed = {}
    for name, direction in (("robot_1", 1.0), ("robot_2", -1.0)):
        numbers = {
            "direction": EffectParameter(direction, None, ""),
            "coulomb": EffectParameter(0.5, 0.01, "N m"),
        }
        diagnosed[name] = [CauseSummary("joint_coupling", "structural", "joint_1", numbers)]
    assert len(common_causes(diagnosed, list(diagnosed))) == 2


def test_robots_without_a_number_in_common_are_not_compared() -> None:
    inertia = {
        name: [
            CauseSummary(
                "link_inertia",
                "parametric",
                "joint_2",
                {moment: EffectParameter(0.1, 0.01, "kg m")},
            )
        ]
        for name, moment in (("robot_1", "change_of_base_MX2"), ("robot_2", "change_of_base_MZ2"))
    }
    assert [cause.of_type for cause in common_causes(inertia, list(inertia))] == [False, False]


def test_a_cause_of_zeros_is_not_named() -> None:
    assert is_nothing(drift((1.1e5, 1.3e6), (40.0, 500.0)))
    assert not is_nothing(drift((30.0, 4.0), (0.5, 0.02)))
    assert not is_nothing(CauseSummary("backlash", "structural", "joint_1"))
    gap = sample_gap()
    zero = {name: EffectParameter(0.1, 1.0, "N m") for name in gap.causes[0].parameters}
    without = replace(gap, causes=(replace(gap.causes[0], parameters=zero), *gap.causes[1:]))
    assert len(gap_summary(gap).causes) == len(gap.causes)
    assert [cause.effect for cause in gap_summary(without).causes] == [
        cause.effect for cause in gap.causes[1:]
    ]
