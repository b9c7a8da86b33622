"""Causes of several robots: what is of the type, and what is of one robot, by sign and size."""

from dataclasses import replace

import pytest

from idim_iv_ros.effects.cause import EffectParameter
from idim_iv_ros.fleet.commands import gap_summary
from idim_iv_ros.fleet.result import CauseSummary, CommonCause
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
def test_robots_have_a_cause_in_common_where_sign_and_size_agree(sizes, groups) -> None:
    diagnosed = {name: [level(size)] for name, size in zip(ORDINARY, sizes, strict=True)}
    causes = common_causes(diagnosed, ORDINARY)
    assert [len(cause.robots) for cause in causes] == groups
    assert [cause.of_type for cause in causes] == [count >= 2 for count in groups]


def coupling(direction: float) -> CauseSummary:
    """Friction that couples two joints in a direction, 1 or -1."""
    signed = EffectParameter(direction, None, "")
    numbers = {"direction": signed, "coulomb": EffectParameter(0.5, 0.01, "N m")}
    return CauseSummary("joint_coupling", "structural", "joint_1", numbers)


def inertia(moment: str) -> CauseSummary:
    """A change of one moment of a link."""
    numbers = {f"change_of_base_{moment}": EffectParameter(0.1, 0.01, "kg m")}
    return CauseSummary("link_inertia", "parametric", "joint_2", numbers)


@pytest.mark.parametrize(
    ("first", "second", "agree"),
    [
        (level(0.1, 0.2), level(0.5, 0.1), True),  # wide intervals agree with sizes in them
        (gain(1.1), gain(0.9), False),  # compared by its distance from one
        (coupling(1.0), coupling(-1.0), False),
        (inertia("MX2"), inertia("MZ2"), False),  # no number in common
    ],
)
def test_two_robots_agree(first: CauseSummary, second: CauseSummary, agree: bool) -> None:
    causes = common_causes({"robot_1": [first], "robot_2": [second]}, ["robot_1", "robot_2"])
    assert [cause.of_type for cause in causes] == ([True] if agree else [False, False])


def test_a_cause_of_zeros_is_not_named() -> None:
    assert is_nothing(gain(1.015)) and not is_nothing(gain(1.1))
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
