"""Parameter errors that no cause names are listed with their joint, in N m and of its torque."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from idim_iv_ros.diagnosis.parametric.causes import parameter_errors, remaining
from idim_iv_ros.diagnosis.sentences import remaining_parameter_errors

DATA: Any = SimpleNamespace(
    joints=("joint_1", "joint_2"), unit_at=lambda *_: "N m", left_out=frozenset()
)


def outcome(after: list[float]) -> Any:
    return SimpleNamespace(
        given=np.array([8.0, 0.8]),
        after=np.array(after),
        refit=np.array([1.0, 0.1]),
        sizes=np.array([100.0, 5.0]),
    )


def said(after: list[float]) -> str:
    return remaining_parameter_errors(DATA, remaining(parameter_errors(DATA, outcome(after))))


def test_every_joint_with_a_remaining_error_is_named_the_largest_share_first() -> None:
    text = said([5.1, 0.8])
    # √(0.8² − 0.1²) = 0.794 of 5 N m; √(5.1² − 1²) = 5.00 of 100 N m
    assert text.startswith(
        "Remaining parameter error: 0.794 N m at joint_2 (16 % of its torque), "
        "5 N m at joint_1 (5 % of its torque)"
    )


@pytest.mark.parametrize("after", [[1.1, 0.11], [2.0, 0.1], [1.4, 0.14]])
def test_what_the_causes_explain_or_is_small_is_not_said(after: list[float]) -> None:
    assert said(after) == ""


def test_without_a_given_model_there_is_no_parameter_error() -> None:
    nothing: Any = SimpleNamespace(given=None)
    assert parameter_errors(DATA, nothing) == ()
    assert remaining_parameter_errors(DATA, ()) == ""
