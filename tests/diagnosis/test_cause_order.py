"""In which order causes are told, and which of them in the summary."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from idim_iv_ros.diagnosis.answer.causes import strongest_first
from idim_iv_ros.diagnosis.result import Cause, Evidence, Gap, JointChange
from idim_iv_ros.diagnosis.sentences import further_causes, summary
from tests.diagnosis.test_verdict import cause

# Torques of 10 and 1 N m rms.
DATA = SimpleNamespace(
    joints=("joint_1", "joint_2"),
    rows=(SimpleNamespace(torque=np.full(4, 10.0)), SimpleNamespace(torque=np.full(4, 1.0))),
)


def closing(effect: str, kind: str, joint: str, before: float, after: float, size: float) -> Cause:
    made = replace(
        cause(effect, kind), joint=joint, torque_gap=Gap(before, after, None, None, None)
    )
    return replace(made, evidence=Evidence(size, 1e-9, None, ""))


FIRST = closing("stribeck", "structural", "joint_1", 2.0, 1.0, 50.0)
SECOND = closing("elasticity", "structural", "joint_1", 1.0, 0.9, 900.0)
LAW = closing("controller_mismatch", "structural", "joint_1", 0.5, 0.1, 100.0)
SMALL = closing("friction_level", "parametric", "joint_1", 0.6, 0.5, 1e4)
LARGE = closing("payload", "parametric", "joint_2", 0.9, 0.1, 1e3)


def names(causes: list[Cause]) -> list[str]:
    return [cause.effect for cause in causes]


def test_structural_causes_stay_in_the_order_of_their_stages() -> None:
    assert names(strongest_first([FIRST, SECOND], DATA)) == ["stribeck", "elasticity"]  # type: ignore[arg-type]


@pytest.mark.parametrize(("evidence", "place"), [(800.0, 2), (1000.0, 0)])
def test_another_law_is_placed_by_its_evidence(evidence: float, place: int) -> None:
    law = replace(LAW, evidence=replace(LAW.evidence, statistic=evidence))
    ordered = names(strongest_first([FIRST, SECOND, law], DATA))  # type: ignore[arg-type]
    assert ordered.index("controller_mismatch") == place


def test_causes_of_both_kinds_go_by_the_share_of_their_joints_torque() -> None:
    ordered = strongest_first([SMALL, FIRST, LARGE], DATA)  # type: ignore[arg-type]
    assert names(ordered) == ["payload", "stribeck", "friction_level"]


def test_what_a_cause_takes_at_other_joints_counts() -> None:
    """0.1 N m at its own joint, 6 of 10 N m at another."""
    wide = replace(
        SMALL,
        joint_gaps=(
            JointChange("joint_1", 0.6, 0.5, 0.03),
            JointChange("joint_2", 8.0, 5.3, 0.6),
            JointChange("joint_2", 0.1, 0.2, -0.01),
        ),
    )
    ordered = strongest_first([FIRST, wide], DATA)  # type: ignore[arg-type]
    assert names(ordered) == ["friction_level", "stribeck"]


def test_a_summary_ends_at_120_words_with_the_weightiest_first() -> None:
    long = ["one " * 59 + "one", "two " * 49 + "two", "three " * 30, "four"]
    words = summary(long).split()
    assert len(words) <= 120
    assert [words.count(word) for word in ("one", "two")] == [58, 48]  # first and last differ
    assert "three" not in words
    assert words[-1] == "Four."


def test_further_causes_are_counted() -> None:
    causes = [LARGE, SMALL, FIRST, SECOND, LARGE, SMALL]
    text = further_causes(causes)
    assert "2 smaller causes" in text and "payload" in text
    assert further_causes([]) == ""


@pytest.mark.parametrize(
    ("effect", "kind"), [("drive_inertia", "parametric"), ("time_delay", "structural")]
)
def test_what_was_put_in_before_anything_else_stands_first(effect: str, kind: str) -> None:
    """Drive inertia that the configuration leaves out, and a delay of all joints."""
    of_all = replace(closing(effect, kind, "", 0.1, 0.09, 1e2), joint=None)
    of_a_joint = closing(effect, kind, "joint_2", 0.1, 0.09, 1e2)
    causes = strongest_first([FIRST, LARGE, of_all], DATA)  # type: ignore[arg-type]
    assert names(causes)[0] == effect
    assert names(strongest_first([FIRST, LARGE, of_a_joint], DATA))[0] != effect  # type: ignore[arg-type]
