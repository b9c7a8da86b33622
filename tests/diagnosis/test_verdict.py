"""The verdict in one word, for every combination of causes."""

from dataclasses import replace

import pytest

from idim_iv_ros.diagnosis.answer.causes import verdict_of
from idim_iv_ros.diagnosis.result import Cause, Evidence, Gap, Hint, JointGap, Unexplained
from idim_iv_ros.diagnosis.sentences import largest_gap, not_in_catalogue

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


def test_the_share_of_events_is_said_once_and_not_of_another_model() -> None:
    bang = Unexplained("joint_2", "event", 0.37, "joint_2: 1 % of the samples hold 37 %")
    assert not_in_catalogue(bang, []).count("37 %") == 1
    assert "refit" not in not_in_catalogue(bang, [])
    assert "37 % of the refit" in not_in_catalogue(REST, [])
    assert not_in_catalogue(None, []) == ""


def test_what_may_be_of_the_catalogue_is_not_said_to_be_outside_it() -> None:
    def hint(effect: str, joint: str, probability: float | None) -> Hint:
        return Hint(
            effect=effect,
            joint=joint,
            sentence="",
            parameters={},
            reason="",
            chosen_in_folds="3 of 4",
            torque_gap=Gap(2.0, 1.0, None, None, None),
            probability=probability,
        )

    elsewhere, misfit = hint("stribeck", "joint_1", 0.5), hint("backlash", "joint_2", None)
    assert "not in the catalogue" in not_in_catalogue(REST, [elsewhere, misfit])
    likely = [hint("spring", "joint_2", 0.2), hint("torque_saturation", "joint_2", 0.33)]
    text = not_in_catalogue(REST, [elsewhere, misfit, *likely])
    assert "not in the catalogue" not in text
    assert "torque saturation (33 %)" in text


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
