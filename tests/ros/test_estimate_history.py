"""Results of an identifier as messages, and what it keeps of them."""

import json
from dataclasses import replace
from math import isnan
from pathlib import Path

import numpy as np
import pytest

from idim_iv_interfaces.msg import GapReport, InstrumentTest, ResidualDiagnosis
from idim_iv_ros.diagnosis.result.document import GapResult
from idim_iv_ros.errors import DataError, UsageError
from idim_iv_ros.identification.result import NOT_SIGNIFICANT
from idim_iv_ros.nodes.identifier.estimate_history import (
    FILE,
    EstimateHistory,
    PastEstimates,
    drift_report,
)
from idim_iv_ros.nodes.identifier.publishers import GapPublisher, gap_message, result_message
from tests.report.sample_result import sample_result

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
    assert [drift.name for drift in comparison.drifting] == ["p0"]
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


EXAMPLE = Path(__file__).with_name("gap.json")  # written by hand, after the design
SEVEN = 7 * 10**9  # ns


def report(result: GapResult) -> GapReport:
    return gap_message(result, SEVEN, ["a.mcap"], "diagnosis")


@pytest.fixture(scope="module")
def example() -> GapReport:
    return report(GapResult.read(EXAMPLE))


def require_same(value: object, expected: object) -> None:
    """A message, or a part of one, holds what the document holds under the same names."""
    if hasattr(value, "get_fields_and_field_types"):
        names = [name for name in value.get_fields_and_field_types() if name in (expected or {})]
        assert names or expected is None
        for name in names:
            require_same(getattr(value, name), expected[name])
    elif isinstance(expected, dict):  # parameters by their names
        assert [part.name for part in value] == list(expected)
        require_same(value, list(expected.values()))
    elif isinstance(expected, list):
        assert len(value) == len(expected)
        for part, wanted in zip(value, expected, strict=True):
            require_same(part, wanted)
    elif expected is None:
        assert value == "" or isnan(value)
    else:
        assert value == expected


def test_message_holds_what_gap_json_holds(example: GapReport) -> None:
    document = json.loads(EXAMPLE.read_text())
    for cause in document["causes"]:
        cause.update(cause.pop("evidence"))
    document.update(document.pop("where"))
    for stage in document["stages"]:
        for name in ("torque_rms", "tracking_rms"):
            stage[name] = [(stage[name] or {}).get(joint) for joint in ("joint_1", "joint_2")]
    del document["bags"]
    require_same(example, document)
    assert (example.header.stamp.sec, list(example.bags), example.duration) == (7, ["a.mcap"], 5.5)
    assert list(example.files) == ["diagnosis/gap.json", "diagnosis/report.html"]


def test_message_holds_intervals_and_the_rest_under_its_own_names(example: GapReport) -> None:
    stribeck, payload = example.causes
    gap, hint = stribeck.torque_gap, example.hints[0].torque_gap
    assert (gap.shrinkage_low, gap.shrinkage_high) == (0.9, 0.99)
    assert (hint.shrinkage_low, hint.shrinkage_high) == (-0.1, 0.3)
    assert payload.chosen_in_folds == ""  # written before searches were repeated
    (regime,) = example.regimes
    assert (regime.lift_low, regime.lift_high) == (5.1, 8.2)
    given, _ = example.stages
    assert (list(given.torque_rms_low), list(given.torque_rms_high)) == ([0.1, 0.5], [0.3, 0.7])
    assert (example.unexplained_joint, example.unexplained_family) == ("joint_1", "position")
    assert (example.unexplained_share, example.unexplained_where) == (0.2, "a bump at 0.3 rad")


def test_what_does_not_exist_is_nan_or_empty(example: GapReport) -> None:
    stribeck, payload = example.causes
    amplitude, speed = stribeck.parameters
    without = report(replace(GapResult.read(EXAMPLE), signal_chain=None, unexplained=None))
    chain = without.signal_chain
    nothing = [
        speed.std,
        amplitude.given_value,
        payload.held_out_gain,
        payload.torque_gap.shrinkage,
        payload.torque_gap.shrinkage_low,
        payload.simulation_gap.before,
        stribeck.simulation_gap.noise_floor,
        example.joints[0].noise_floor,
        example.joints[1].relative_percent,
        *example.stages[1].torque_rms_low,
        *example.stages[1].tracking_rms,
        chain.effort_shift.value,
        chain.periods,
        without.unexplained_share,
    ]
    assert all(map(isnan, nothing))
    assert (chain.effort_shift.name, chain.law_speed, list(chain.joint_shifts)) == ("", "", [])
    assert (without.unexplained_joint, without.unexplained_where) == ("", "")


def test_an_identification_is_a_message_with_remarks_and_what_whitening_moves() -> None:
    result = sample_result(2, "coloured")
    result = replace(result, refined=replace(result.refined, moved=("Fv2",)))
    message = result_message(result, SEVEN, ["a.mcap"], "identification")
    estimates = message.parameters.estimates
    assert message.parameters.header.stamp.sec == 7
    remarks = [estimate.remark for estimate in estimates]
    assert remarks == [parameter.remark for parameter in result.parameters]
    assert NOT_SIGNIFICANT in remarks
    assert list(message.parameters.covariance) == result.covariance.ravel().tolist()
    refined = [estimate.value for estimate in message.refined_estimates]
    assert refined == [parameter.value for parameter in result.refined.parameters]
    assert list(message.moved) == ["Fv2"]
    assert [residual.whiteness for residual in message.residuals] == [
        ResidualDiagnosis.AUTOCORRELATED
    ] * 2
    assert [(item.scope, item.null_hypothesis) for item in message.exogeneity] == [
        (test.scope, test.null) for test in result.exogeneity.tests
    ]
    assert message.exogeneity[-1].outcome == InstrumentTest.NOT_RUN
    assert isnan(message.exogeneity[-1].p_value)
    assert message.files == ["identification/result.json", "identification/report.html"]


@pytest.mark.parametrize("text", ["{", "[]", '{"format": "idim_iv_ros/gap/1"}'])
def test_a_damaged_last_diagnosis_is_a_warning(tmp_path: Path, text: str, observer) -> None:
    (tmp_path / "diagnosis_1").mkdir()
    (tmp_path / "diagnosis_1" / "gap.json").write_text(text)
    publisher = GapPublisher(observer.node, tmp_path)
    publisher.publish_last()
    assert publisher.last is None
