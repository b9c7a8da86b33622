"""The answer: its verdict, the order and the words of causes, and what the last model misses."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from idim_iv_ros.diagnosis import sentences
from idim_iv_ros.diagnosis.answer.causes import strongest_first, verdict_of
from idim_iv_ros.diagnosis.answer.explained import unexplained_residual
from idim_iv_ros.diagnosis.refit.baseline import Baseline
from idim_iv_ros.diagnosis.refit.noise_floor import NoiseFloor
from idim_iv_ros.diagnosis.result.causes import Cause, Evidence, Gap, JointChange, Unexplained
from idim_iv_ros.diagnosis.result.document import JointGap, Stage
from idim_iv_ros.diagnosis.sentences import largest_gap
from idim_iv_ros.effects.parametric_effect import Change, Estimated
from idim_iv_ros.effects.registry import parameter_words
from idim_iv_ros.effects.torque_gain import TorqueGain

REST = Unexplained("joint_2", "velocity", 0.37, "joint_2: a curve")
GAPS = [
    JointGap("joint_1", 0.5, 7.0, 0.2, None, "lower bound"),
    JointGap("joint_2", 0.3, 12.34, 0.8, None, "lower bound"),
]


def cause(effect: str, kind: str) -> Cause:
    gap = Gap(2.0, 1.0, 0.5, 0.667, None)
    return Cause(
        effect=effect,
        kind=kind,  # type: ignore[arg-type]
        joint="joint_1",
        parameters={},
        evidence=Evidence(100.0, 0.3, "4 of 4"),
        torque_gap=gap,
        sentence=f"{effect} at joint_1: it shrinks",
    )


PAYLOAD, STRIBECK = cause("payload", "parametric"), cause("stribeck", "structural")


@pytest.mark.parametrize(
    ("causes", "rest", "word"),
    [
        ([], None, "none"),
        ([], REST, "unknown"),
        ([PAYLOAD], None, "parametric"),
        ([PAYLOAD], REST, "unknown"),
        ([STRIBECK], None, "structural"),
        ([STRIBECK], REST, "structural"),
        ([STRIBECK, PAYLOAD], None, "both"),
        ([PAYLOAD, STRIBECK], REST, "both"),
    ],
)
def test_verdict_of_causes_and_what_is_outside(causes, rest, word) -> None:
    assert verdict_of(causes, rest) == word


def test_the_largest_gap_is_that_of_the_model_that_is_given() -> None:
    assert "12.3 % of the torque at joint_2" in largest_gap(GAPS, "refit")
    noisy = [replace(GAPS[0], noise_floor=0.4), replace(GAPS[1], share=0.1, noise_floor=0.29)]
    assert "4.2 % of the torque beyond noise at joint_1" in largest_gap(noisy, "refit")
    no_model = [JointGap("joint_1", 0.5, None, 1.0, None, "lower bound")]
    assert largest_gap(no_model, "nominal model") == largest_gap([], "refit") == ""


def test_the_part_of_a_gap_beyond_the_noise_is_that_of_its_energy() -> None:
    assert replace(GAPS[0], noise_floor=0.4).beyond_noise_percent == pytest.approx(7.0 * 0.6)
    assert replace(GAPS[0], noise_floor=0.6).beyond_noise_percent == 0.0
    assert GAPS[0].beyond_noise_percent == 7.0


def test_much_that_stays_is_not_nothing() -> None:
    assert verdict_of([], None, unexplained=True) == "unknown"
    assert verdict_of([], None, parameters=True) == "parametric"
    assert verdict_of([], None, parameters=True, unexplained=True) == "unknown"
    assert verdict_of([STRIBECK], None, unexplained=True) == "structural"


DATA = SimpleNamespace(joints=("joint_1", "joint_2"), torque_sizes=(10.0, 1.0))  # N m rms


def closing(effect: str, kind: str, joint: str, before: float, after: float, size: float) -> Cause:
    gap = Gap(before, after, None, None, None)
    return replace(cause(effect, kind), joint=joint, torque_gap=gap, evidence=Evidence(size))


FIRST = closing("stribeck", "structural", "joint_1", 2.0, 1.0, 50.0)
SECOND = closing("elasticity", "structural", "joint_1", 1.0, 0.9, 900.0)
LAW = closing("controller_mismatch", "structural", "joint_1", 0.5, 0.1, 100.0)
SMALL = closing("friction_level", "parametric", "joint_1", 0.6, 0.5, 1e4)
LARGE = closing("payload", "parametric", "joint_2", 0.9, 0.1, 1e3)


# 0.1 N m at its own joint, 6 of 10 N m at another.
WIDE = replace(
    SMALL,
    joint_gaps=(
        JointChange("joint_1", 0.6, 0.5, 0.03),
        JointChange("joint_2", 8.0, 5.3, 0.6),
        JointChange("joint_2", 0.1, 0.2, -0.01),
    ),
)


def law(evidence: float) -> Cause:
    return replace(LAW, evidence=replace(LAW.evidence, statistic=evidence))


def delay(joint: str | None) -> Cause:
    return replace(closing("time_delay", "structural", "", 0.1, 0.09, 1e2), joint=joint)


@pytest.mark.parametrize(
    ("causes", "effects"),
    [
        # Structural ones stay in the order of their stages; another law is placed by its evidence.
        ([FIRST, SECOND], ["stribeck", "elasticity"]),
        ([FIRST, SECOND, law(800.0)], ["stribeck", "elasticity", "controller_mismatch"]),
        ([FIRST, SECOND, law(1000.0)], ["controller_mismatch", "stribeck", "elasticity"]),
        # Causes of both kinds go by the share of their joint's torque, at any joint.
        ([SMALL, FIRST, LARGE], ["payload", "stribeck", "friction_level"]),
        ([FIRST, WIDE], ["friction_level", "stribeck"]),
        # What was put in before anything else comes first, if it is of all joints.
        ([FIRST, LARGE, delay(None)], ["time_delay", "payload", "stribeck"]),
        ([FIRST, LARGE, delay("joint_2")], ["payload", "stribeck", "time_delay"]),
    ],
)
def test_causes_are_in_the_order_of_their_weight(causes, effects) -> None:
    assert [cause.effect for cause in strongest_first(causes, DATA)] == effects


def test_a_gain_of_1_25_is_a_factor_of_1_25() -> None:
    """Recorded torque 0.8 of the actual one: the actual is 1.25 times the recorded."""
    estimates = [Estimated(Change("recorded_more", "", np.zeros(1)), 0.8 - 1.0, 0.01)]
    (only,) = TorqueGain().parameters(estimates).items()
    name, number = only
    assert parameter_words("torque_gain", name) == "actual torque over recorded torque"
    assert number.value == pytest.approx(1.25)
    assert number.std == pytest.approx(0.01 / 0.8**2)


@pytest.mark.parametrize(
    ("effect", "name", "words"),
    [
        ("link_inertia", "change_of_MX3", "change of MX3"),
        ("link_inertia", "change_of_base_MX3", "change of MX3 (grouped)"),
        ("payload", "inertia_xy", "moment of inertia xy about the link's frame"),
        ("position_ripple", "sine_12", "torque with the sine 12"),
    ],
)
def test_names_that_are_made_have_words(effect: str, name: str, words: str) -> None:
    assert parameter_words(effect, name) == words


def missed(
    data: Baseline, first: float, shares: tuple[float, float], noise: float | None
) -> list[tuple[int, float, float, float]]:
    """Of a model that misses shares of the torques: joint, rms, share, noise of those said.

    Parameters
    ----------
    first
        What the first model misses of each torque.
    noise
        As a share of what the last one misses.
    """
    stages = []
    for name, share in (("given", np.full(2, first)), ("last", np.array(shares))):
        rms = dict(zip(data.joints, share * np.array(data.torque_sizes), strict=True))
        stages.append(Stage(name, rms, {}, None, ""))
    floors = [
        NoiseFloor(None if noise is None else noise * rms, "repeats", "")
        for rms in stages[-1].torque_rms.values()
    ]
    whole = SimpleNamespace(residuals=[np.array([size, -size]) for size in data.torque_sizes])
    explanation: Any = SimpleNamespace(data=data, whole=whole, floors=floors)
    return unexplained_residual(explanation, stages)


def test_joints_that_miss_much_are_listed_the_worst_first(data: Baseline) -> None:
    joints = missed(data, 1.0, (0.2, 0.5), 0.1)
    assert [(joint, round(share, 9)) for joint, _, share, _ in joints] == [(1, 0.5), (0, 0.2)]
    text = sentences.unexplained_residual(data, joints)
    assert "joint_2 (50 % of its torque" in text
    assert "1 more joint" in text
    assert "N m" in text


@pytest.mark.parametrize(
    ("first", "shares", "noise", "joints"),
    [
        (1.0, (0.2, 0.5), 0.5, []),  # noise
        (1.0, (0.05, 0.02), 0.1, []),  # little
        (1.0, (0.2, 0.5), None, []),  # of unknown noise
        (0.06, (0.05, 0.001), 0.2, [0]),  # a small share, and most of the first gap
        (0.5, (0.05, 0.001), 0.2, []),
        (0.5, (0.15, 0.001), 0.1, [0]),
        (0.025, (0.025, 0.001), 0.4, []),  # may be noise
    ],
)
def test_noise_and_little_are_not(data, first, shares, noise, joints) -> None:
    assert [joint for joint, *_ in missed(data, first, shares, noise)] == joints
