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
    return replace(made, evidence=Evidence(size))


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
