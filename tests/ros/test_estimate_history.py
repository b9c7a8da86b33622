"""Estimates over bags: kept in a file, compared, flagged when they drift."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from idim_iv_ros.errors import DataError
from idim_iv_ros.nodes.identifier.estimate_history import FILE, EstimateHistory, PastEstimates

NAMES = [f"p{k}" for k in range(20)]


def entry(bag: str, values: np.ndarray, std: float = 0.1) -> PastEstimates:
    return PastEstimates(
        stamp=1,
        robot="arm",
        estimator="idim-iv",
        effort_unit="N m",
        bags=(bag,),
        folder=bag,
        values={name: (float(value), std) for name, value in zip(NAMES, values, strict=True)},
    )


def test_history_survives_and_is_bounded(tmp_path: Path) -> None:
    history = EstimateHistory(tmp_path)
    for bag in "abcd":
        history.add(entry(bag, np.ones(20)), length=3)
    again = EstimateHistory(tmp_path)
    assert again.entries == history.entries
    assert [each.bags for each in again.entries] == [("b",), ("c",), ("d",)]


def test_slow_drift_is_found_against_the_first_bag(tmp_path: Path) -> None:
    history = EstimateHistory(tmp_path)
    for k in range(10):
        values = np.full(20, 5.0)
        values[0] += 0.08 * k
        history.add(entry(f"bag{k}", values), length=20)
    assert [drift.parameter for drift in history.drifts(0.01) if drift.drifts] == ["p0"]


def test_only_independent_estimates_of_the_same_kind_are_compared(tmp_path: Path) -> None:
    history = EstimateHistory(tmp_path)
    shifted = entry("b", np.full(20, 9.0))
    for other in (
        replace(entry("a", np.ones(20)), robot="other"),
        replace(entry("a", np.ones(20)), estimator="idim-ls"),
        replace(entry("a", np.ones(20)), effort_unit="A"),
        replace(entry("a", np.ones(20)), bags=("a", "b")),
    ):
        history.entries = [other, shifted]
        assert history.drifts(0.01) == []


def test_repeated_identification_of_a_bag_replaces_the_earlier(tmp_path: Path) -> None:
    history = EstimateHistory(tmp_path)
    for value in (1.0, 2.0):
        history.add(entry("a", np.full(20, value)), length=9)
    assert [each.values["p0"][0] for each in history.entries] == [2.0]


@pytest.mark.parametrize("text", ["", "{", "[]", '{"format": "other"}'])
def test_file_that_is_no_history_is_left_alone(tmp_path: Path, text: str) -> None:
    (tmp_path / FILE).write_text(text)
    with pytest.raises(DataError, match="move it away"):
        EstimateHistory(tmp_path)
    assert (tmp_path / FILE).read_text() == text
