"""Wrong numbers that no cause tells are said, with the joint where they matter most."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from idim_iv_ros.gap import numbers_left as module
from idim_iv_ros.gap.numbers_left import numbers_left
from idim_iv_ros.gap.result import Stage

DATA: Any = SimpleNamespace(
    joints=("joint_1", "joint_2"),
    rows=(SimpleNamespace(torque=np.full(4, 10.0)), SimpleNamespace(torque=np.full(4, 1.0))),
)
STAGES = [
    Stage("given", {"joint_1": 8.0, "joint_2": 0.8}, {}, None, ""),
    Stage("refit", {"joint_1": 1.0, "joint_2": 0.1}, {}, None, ""),
]


@pytest.fixture(autouse=True)
def newton_metres(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "unit_at", lambda *_: "N m")


def said(after: list[float], causes: tuple[int, ...] = ()) -> str:
    outcome: Any = SimpleNamespace(after=np.array(after), causes=causes)
    return numbers_left(DATA, outcome, STAGES)


def test_the_joint_that_misses_most_is_named() -> None:
    text = said([4.0, 0.8])
    assert text.startswith("Given numbers are wrong: new ones take the gap from 0.8 to 0.1 N m")
    assert "joint_2" in text
    assert said([4.0, 0.8], (1,)).startswith("Other given numbers are wrong, too")


@pytest.mark.parametrize("after", [[1.1, 0.11], [1.9, 0.1], [np.nan, np.nan]])
def test_what_the_causes_explain_is_not(after: list[float]) -> None:
    assert said(after) == ""
