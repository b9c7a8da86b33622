"""Results as messages: what gap.json and result.json hold, and what a restart keeps of it."""

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


def test_message_holds_what_gap_json_holds(example: GapReport) -> None:
    stamp = example.header.stamp.sec
    assert (example.robot, example.verdict, stamp) == ("arm2", "structural", 7)
    assert example.summary == "Joint 2 lacks the Stribeck effect."
    assert (example.duration, list(example.without)) == (5.5, ["backlash"])
    assert list(example.files) == ["diagnosis/gap.json", "diagnosis/report.html"]
    stribeck, payload = example.causes
    assert (stribeck.effect, stribeck.kind, stribeck.joint) == ("stribeck", "structural", "joint_2")
    assert [(p.name, p.value, p.unit) for p in stribeck.parameters] == [
        ("amplitude", 0.8, "N m"),
        ("speed", 0.06, "rad/s"),
    ]
    assert (stribeck.statistic, stribeck.probability, stribeck.held_out_gain) == (412.5, 0.93, 0.31)
    assert (stribeck.folds_positive, stribeck.chosen_in_folds) == ("6 of 6", "5 of 6")
    assert payload.chosen_in_folds == ""  # written before searches were repeated
    assert stribeck.sentence == "joint_2 sticks: 0.8 N m below 0.06 rad/s."
    assert [(r.effect, r.joint, r.weight) for r in stribeck.indistinguishable_from] == [
        ("presliding", "joint_2", 0.3),
        ("payload", "", 0.1),
    ]
    torque, simulation = stribeck.torque_gap, stribeck.simulation_gap
    assert (torque.before, torque.after, torque.noise_floor) == (0.62, 0.41, 0.4)
    assert (torque.shrinkage, torque.shrinkage_low, torque.shrinkage_high) == (0.95, 0.9, 0.99)
    assert (simulation.before, simulation.after, simulation.shrinkage) == (0.004, 0.001, 0.75)
    (change,) = stribeck.joint_gaps
    assert (change.joint, change.before, change.after) == ("joint_2", 0.62, 0.41)
    assert change.share_of_torque == 0.12
    assert (payload.kind, payload.joint, list(payload.parameters)) == ("parametric", "", [])
    assert (example.unexplained_joint, example.unexplained_family) == ("joint_1", "position")
    assert (example.unexplained_share, example.unexplained_where) == (0.2, "a bump at 0.3 rad")


def test_message_says_what_is_suspected_and_not_confirmed(example: GapReport) -> None:
    (hint,) = example.hints
    assert (hint.effect, hint.joint, hint.other_joint) == ("joint_coupling", "joint_1", "joint_2")
    (viscous,) = hint.parameters
    assert (viscous.name, viscous.value, viscous.std) == ("viscous", 0.4, 0.15)
    assert (viscous.unit, hint.chosen_in_folds) == ("N m s/rad", "2 of 6")
    assert (hint.torque_gap.shrinkage, hint.torque_gap.shrinkage_low) == (0.1, -0.1)
    assert isnan(hint.torque_gap.noise_floor)
    assert hint.reason == "a search names it without 2 of 6 blocks only"
    assert hint.sentence.startswith("joint_1 may be braked by joint_2")


def test_message_says_where_the_gap_lies_and_how_it_shrinks(example: GapReport) -> None:
    assert [(j.joint, j.rms, j.share, j.floor_origin) for j in example.joints] == [
        ("joint_1", 0.2, 0.1, ""),
        ("joint_2", 0.62, 0.9, "repeats"),
    ]
    (regime,) = example.regimes
    assert (regime.joint, regime.axis, regime.unit) == ("joint_2", "speed", "rad/s")
    assert (regime.low, regime.high, regime.lift_low, regime.lift_high) == (0.0, 0.1, 5.1, 8.2)
    assert (regime.energy_share, regime.occupancy, regime.lift) == (0.61, 0.09, 6.8)
    given, extended = example.stages
    assert (given.stage, list(given.torque_rms)) == ("given", [0.2, 0.62])
    assert (list(given.torque_rms_low), list(given.torque_rms_high)) == ([0.1, 0.5], [0.3, 0.7])
    assert list(given.tracking_rms) == [0.001, 0.004]
    assert (extended.stage, list(extended.torque_rms)) == ("+stribeck[joint_2]", [0.19, 0.41])
    assert extended.note == "the loop diverges"
    assert len(example.findings) == 1 and list(example.notes) == ["no repeats"]
    (untestable,) = example.not_testable
    assert (untestable.effect, untestable.joint) == ("gravity_direction", "")
    assert untestable.reason == "the axes are vertical"
    assert untestable.excitation_needed == "tilt the base"


def test_message_says_what_parameters_and_the_signal_chain_do(example: GapReport) -> None:
    (error,) = example.parameter_errors
    assert (error.joint, error.given, error.named, error.refit) == ("joint_1", 0.2, 0.15, 0.12)
    assert (error.remaining, error.share_of_torque) == (0.09, 0.02)
    chain = example.signal_chain
    shift = chain.effort_shift
    assert (shift.value, shift.std, shift.unit, chain.periods) == (0.0015, 0.0001, "s", 1.5)
    shifts = [(shift.name, shift.value) for shift in chain.joint_shifts]
    assert shifts == [("joint_1", 0.0014), ("joint_2", 0.0016)]
    assert isnan(chain.joint_shifts[1].std)
    assert (list(chain.differing), chain.law_speed) == (["joint_2"], "the measured speed")


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
    """A contrast, transmissions, physical parameters."""
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
