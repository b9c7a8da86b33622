"""Results as messages: what gap.json and result.json hold, and what a restart keeps of it."""

import json
from dataclasses import replace
from math import isnan
from pathlib import Path

import pytest

from idim_iv_interfaces.msg import GapReport, InstrumentTest, ResidualDiagnosis
from idim_iv_ros.diagnosis.result import GapResult
from idim_iv_ros.identification.result import NOT_SIGNIFICANT
from idim_iv_ros.nodes.identifier.publishers import GapPublisher, gap_message, result_message
from tests.report.sample_everything import sample_everything
from tests.report.sample_gap import CASES, Case, sample_gap
from tests.report.sample_result import sample_result

EXAMPLE = Path(__file__).with_name("gap.json")  # written by hand, after the design
SEVEN = 7 * 10**9  # ns


def report(result: GapResult) -> GapReport:
    return gap_message(result, SEVEN, ["a.mcap"], "diagnosis")


@pytest.fixture(scope="module")
def example() -> GapReport:
    return report(GapResult.read(EXAMPLE))


def plain(part: object) -> object:
    """What a message holds, without headers, as JSON has it; NaN is null."""
    if hasattr(part, "get_fields_and_field_types"):
        names = part.get_fields_and_field_types().keys() - {"header"}
        return {name: plain(getattr(part, name)) for name in names}
    if isinstance(part, float):
        return None if isnan(part) else part
    if isinstance(part, str | int):
        return part
    return [plain(item) for item in part]


def test_message_holds_what_gap_json_holds(example: GapReport) -> None:
    """`gap_message.json` was compared by hand with `gap.json`, field by field."""
    assert plain(example) == json.loads(EXAMPLE.with_name("gap_message.json").read_text())
    assert example.header.stamp.sec == 7


def test_what_does_not_exist_is_nan_or_empty() -> None:
    without = report(replace(GapResult.read(EXAMPLE), signal_chain=None, unexplained=None))
    chain = without.signal_chain
    assert all(map(isnan, (chain.effort_shift.value, chain.periods, without.unexplained_share)))
    assert (chain.effort_shift.name, chain.law_speed, list(chain.joint_shifts)) == ("", "", [])
    assert (without.unexplained_joint, without.unexplained_where) == ("", "")


@pytest.mark.parametrize("case", CASES)
def test_every_verdict_becomes_a_message(case: Case) -> None:
    result = sample_gap(case=case, given=case != "none", tracking=case != "both")
    message = report(result)
    assert (message.verdict, message.summary) == (result.verdict, result.summary)
    assert [c.sentence for c in message.causes] == [c.sentence for c in result.causes]
    assert [joint.joint for joint in message.joints] == list(result.joints)
    assert [stage.stage for stage in message.stages] == [stage.name for stage in result.stages]
    assert len(message.regimes) == len(result.regimes)
    assert (message.unexplained_joint == "") == (result.unexplained is None)


def test_what_messages_have_no_field_for_is_left_to_gap_json(tmp_path: Path) -> None:
    """A contrast, transmissions, physical parameters; causes without a p-value."""
    result = sample_everything(tmp_path)
    assert result.hints and result.contrast and result.transmissions and result.physical
    message = report(result)
    assert [cause.effect for cause in message.causes] == [cause.effect for cause in result.causes]
    assert [hint.sentence for hint in message.hints] == [hint.sentence for hint in result.hints]
    assert all(isnan(cause.probability) for cause in message.causes)


def test_an_identification_is_a_message_with_remarks_and_what_whitening_moves() -> None:
    result = sample_result(2, "coloured")
    assert result.refined is not None
    result = replace(result, refined=replace(result.refined, moved=("Fv2",)))
    message = result_message(result, SEVEN, ["a.mcap"], "identification")
    estimates = message.parameters.estimates
    assert message.parameters.header.stamp.sec == 7
    assert [estimate.remark for estimate in estimates] == [
        parameter.remark for parameter in result.parameters
    ]
    assert NOT_SIGNIFICANT in {estimate.remark for estimate in estimates}
    assert list(message.parameters.covariance) == result.covariance.ravel().tolist()
    assert [refined_estimate.value for refined_estimate in message.refined_estimates] == [
        parameter.value for parameter in result.refined.parameters
    ]
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


@pytest.mark.parametrize("text", ["{", "[]", '{"format": "idim_iv_ros/last_gap/1"}'])
def test_damaged_record_of_the_last_diagnosis_is_a_warning(
    tmp_path: Path, text: str, observer
) -> None:
    (tmp_path / "last_gap.json").write_text(text)
    publisher = GapPublisher(observer.node, tmp_path)
    publisher.publish_last()
    assert publisher.last is None
