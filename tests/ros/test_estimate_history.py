"""Estimates over bags: kept in a file, compared, flagged when they drift."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from idim_iv_ros.errors import DataError, UsageError
from idim_iv_ros.nodes.identifier.estimate_history import (
    FILE,
    EstimateHistory,
    PastEstimates,
    drift_report,
)

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
    assert [item.bags for item in again.entries] == [("b",), ("c",), ("d",)]


def test_slow_drift_is_found_against_the_first_bag(tmp_path: Path) -> None:
    history = EstimateHistory(tmp_path)
    for k in range(10):
        values = np.full(20, 5.0)
        values[0] += 0.08 * k
        history.add(entry(f"bag{k}", values), length=20)
    (comparison,) = history.comparisons(0.01)
    assert [drift.parameter for drift in comparison.drifting] == ["p0"]
    assert comparison.baseline is not None
    assert comparison.baseline.bags == ("bag0",)


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
        assert all(item.drifts == () for item in history.comparisons(0.01))


def test_repeated_identification_of_a_bag_replaces_the_earlier(tmp_path: Path) -> None:
    history = EstimateHistory(tmp_path)
    for value in (1.0, 2.0):
        history.add(entry("a", np.full(20, value)), length=9)
    assert [item.values["p0"][0] for item in history.entries] == [2.0]


@pytest.mark.parametrize("text", ["", "{", "[]", '{"format": "other"}'])
def test_file_that_is_no_history_is_left_alone(tmp_path: Path, text: str) -> None:
    (tmp_path / FILE).write_text(text)
    with pytest.raises(DataError, match="move it away"):
        EstimateHistory(tmp_path)
    assert (tmp_path / FILE).read_text() == text


def stamped(bag: str, first: float, stamp: int, **other: object) -> PastEstimates:
    values = np.full(20, 5.0)
    values[0] += first
    return replace(entry(bag, values), stamp=stamp, **other)


def test_a_baseline_that_is_set_is_kept(tmp_path: Path) -> None:
    history = EstimateHistory(tmp_path)
    for stamp, first in enumerate((0.0, 2.0)):
        history.add(stamped(f"bag{stamp}", first, stamp), length=3)
    assert history.set_baseline("bag1").bags == ("bag1",)
    assert history.comparisons(0.01)[0].drifts == ()  # the newest is the baseline itself
    for stamp in range(2, 8):
        history.add(stamped(f"bag{stamp}", 2.0, stamp), length=3)
    again = EstimateHistory(tmp_path)
    assert [entry.bags for entry in again.entries] == [("bag1",), ("bag6",), ("bag7",)]
    (comparison,) = again.comparisons(0.01)
    assert comparison.baseline is not None
    assert comparison.baseline.bags == ("bag1",)
    assert comparison.drifting == ()
    with pytest.raises(UsageError, match="nowhere"):
        again.set_baseline("nowhere")


def test_a_message_tells_what_changed_and_since_when(tmp_path: Path) -> None:
    history = EstimateHistory(tmp_path)
    for stamp, first in enumerate((0.0, 2.0)):
        history.add(stamped(f"bag{stamp}", first, stamp * 1_000_000_000), length=20)
    history.add(stamped("bag9", 0.0, 9_000_000_000, estimator="idim-ls"), length=20)
    report = drift_report(history.comparisons(0.01))
    assert report.drifting
    assert report.message == "idim-iv: p0 5 → 7 (+14.1 σ): changed since bag0"
    first = report.comparisons[0]
    assert (first.since.sec, list(first.baseline_bags)) == (1, ["bag0"])
    assert (first.parameters[0].before, first.parameters[0].now) == (5.0, 7.0)
    assert [parameter.drifts for parameter in first.parameters] == [True] + 19 * [False]
    assert list(report.comparisons[1].parameters) == []
