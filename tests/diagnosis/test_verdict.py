"""The verdict in one word and in one paragraph, for every combination of causes."""

import pytest

from idim_iv_ros.diagnosis.result import Cause, Evidence, Gap, JointGap, Unexplained, Verdict
from idim_iv_ros.diagnosis.sentences import summary
from idim_iv_ros.diagnosis.verdict import verdict_of

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
        other_joint=None,
        parameters={},
        evidence=Evidence(100.0, 1e-9, 0.3, "4 of 4"),
        indistinguishable_from=(),
        torque_gap=gap,
        simulation_gap=None,
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
def test_verdict_and_what_its_summary_says(
    causes: list[Cause], rest: Unexplained | None, word: Verdict
) -> None:
    assert verdict_of(causes, rest) == word
    text = summary(word, causes, rest, GAPS, ())
    assert text.startswith("The nominal model misses 12.3 % of the torque at joint_2")
    assert ("than chance" in text) == (word == "none")
    for each in causes:
        assert each.sentence[1:] + "." in text
    assert ("Not in the catalogue: joint_2: a curve; it explains 37 %" in text) == (
        rest is not None
    )
    assert "\n" not in text
    assert "Left out" not in text


def test_the_share_of_events_is_said_once_and_not_of_another_model() -> None:
    bang = Unexplained("joint_2", "event", 0.37, "joint_2: 1 % of the samples hold 37 %")
    text = summary("unknown", [], bang, GAPS, ())
    assert text.count("37 %") == 1
    assert "refit" not in text


def test_without_a_given_model_the_gap_is_that_of_the_refit() -> None:
    text = summary("none", [], None, GAPS, (), model="refit")
    assert text.startswith("The refit misses 12.3 % of the torque at joint_2")


def test_much_that_stays_is_not_nothing() -> None:
    assert verdict_of([], None, unexplained=True) == "unknown"
    assert verdict_of([], None, parameters=True) == "parametric"
    assert verdict_of([], None, parameters=True, unexplained=True) == "unknown"
    assert verdict_of([STRIBECK], None, unexplained=True) == "structural"
    text = summary("unknown", [], None, GAPS, (), remaining="Errors.", residual="Unexplained.")
    assert text.endswith("Errors. Unexplained.")
    assert "than chance" not in text


def test_what_was_left_out_is_said_and_a_missing_given_model_is_not() -> None:
    no_model = [JointGap("joint_1", 0.5, None, 1.0, None, "lower bound")]
    text = summary("none", [], None, no_model, ("stribeck", "payload"))
    assert "nominal model" not in text
    assert text.endswith("Left out of the catalogue on request: stribeck, payload.")
    assert summary("none", [], None, [], ())
