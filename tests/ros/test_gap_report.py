"""A diagnosis as a message: what gap.json holds, and what a restart keeps of it."""

import json
import shutil
from math import isnan
from pathlib import Path

import pytest
from builtin_interfaces.msg import Time
from idim_iv_ros.nodes.identifier.gap_messages import gap_message
from idim_iv_ros.report.gap_format import read_gap
from idim_iv_ros.report.gap_json import gap_document

from idim_iv_interfaces.msg import GapReport
from idim_iv_ros.errors import DataError
from idim_iv_ros.nodes.identifier.gap_publisher import GapPublisher
from tests.report.sample_gap import CASES, Case, sample_gap

EXAMPLE = Path(__file__).with_name("gap.json")  # written by hand, after the design


@pytest.fixture
def results(tmp_path: Path) -> Path:
    """An output directory with the example in the folder `diagnosis`."""
    folder = tmp_path / "results"
    (folder / "diagnosis").mkdir(parents=True)
    shutil.copy(EXAMPLE, folder / "diagnosis" / "gap.json")
    return folder


def report(results: Path) -> GapReport:
    document = read_gap(results / "diagnosis" / "gap.json")
    return gap_message(document, Time(sec=7), ["a.mcap"], "diagnosis")


def test_message_holds_what_gap_json_holds(results: Path) -> None:
    message = report(results)
    assert (message.robot, message.verdict, message.header.stamp.sec) == ("arm2", "structural", 7)
    assert message.summary == "Joint 2 lacks the Stribeck effect."
    assert (message.duration, list(message.without)) == (5.5, ["backlash"])
    assert list(message.files) == ["diagnosis/gap.json", "diagnosis/report.html"]
    stribeck, payload = message.causes
    assert (stribeck.effect, stribeck.kind, stribeck.joint) == ("stribeck", "structural", "joint_2")
    assert [(p.name, p.value, p.unit) for p in stribeck.parameters] == [
        ("amplitude", 0.8, "N m"),
        ("speed", 0.06, "rad/s"),
    ]
    assert (stribeck.statistic, stribeck.p_value, stribeck.held_out_gain) == (412.5, 1e-30, 0.31)
    assert stribeck.folds_positive == "6 of 6"
    assert stribeck.sentence == "joint_2 sticks: 0.8 N m below 0.06 rad/s."
    assert [(r.effect, r.joint, r.correlation) for r in stribeck.indistinguishable_from] == [
        ("presliding", "joint_2", 0.97),
        ("payload", "", 0.96),
    ]
    torque, simulation = stribeck.torque_gap, stribeck.simulation_gap
    assert (torque.before, torque.after, torque.noise_floor) == (0.62, 0.41, 0.4)
    assert (torque.shrinkage, torque.shrinkage_low, torque.shrinkage_high) == (0.95, 0.9, 0.99)
    assert (simulation.before, simulation.after, simulation.shrinkage) == (0.004, 0.001, 0.75)
    assert (payload.kind, payload.joint, list(payload.parameters)) == ("parametric", "", [])
    assert (message.unexplained_joint, message.unexplained_family) == ("joint_1", "position")
    assert (message.unexplained_share, message.unexplained_where) == (0.2, "a bump at 0.3 rad")


def test_message_says_where_the_gap_lies_and_how_it_shrinks(results: Path) -> None:
    message = report(results)
    assert [(j.joint, j.rms, j.share) for j in message.joints] == [
        ("joint_1", 0.2, 0.1),
        ("joint_2", 0.62, 0.9),
    ]
    assert [j.floor_origin for j in message.joints] == ["", "repeats"]
    (regime,) = message.regimes
    assert (regime.joint, regime.axis, regime.unit) == ("joint_2", "speed", "rad/s")
    assert (regime.low, regime.high, regime.lift_low, regime.lift_high) == (0.0, 0.1, 5.1, 8.2)
    assert (regime.energy_share, regime.occupancy, regime.lift) == (0.61, 0.09, 6.8)
    given, extended = message.stages
    assert (given.stage, list(given.torque_rms)) == ("given", [0.2, 0.62])
    assert (list(given.torque_rms_low), list(given.torque_rms_high)) == ([0.1, 0.5], [0.3, 0.7])
    assert list(given.tracking_rms) == [0.001, 0.004]
    assert (extended.stage, list(extended.torque_rms)) == ("+stribeck[joint_2]", [0.19, 0.41])
    assert extended.note == "the loop diverges"
    assert list(message.findings) == [
        "joint_2, below 0.1 rad/s: 61 % of the gap in 9 % of the samples"
    ]
    assert list(message.notes) == ["no repeats"]
    (untestable,) = message.not_testable
    assert (untestable.effect, untestable.joint) == ("gravity_direction", "")
    assert untestable.reason == "the axes are vertical"
    assert untestable.excitation_needed == "tilt the base"


def test_numbers_that_do_not_exist_are_nan(results: Path) -> None:
    message = report(results)
    stribeck, payload = message.causes
    amplitude, speed = stribeck.parameters
    nothing = [
        speed.std,
        amplitude.given_value,
        payload.held_out_gain,
        payload.torque_gap.shrinkage,
        payload.torque_gap.shrinkage_low,
        payload.simulation_gap.before,
        stribeck.simulation_gap.noise_floor,
        message.joints[0].noise_floor,
        message.joints[1].relative_percent,
        *message.stages[1].torque_rms_low,
        *message.stages[1].tracking_rms,
    ]
    assert all(map(isnan, nothing))


def test_nothing_unexplained_is_empty(results: Path) -> None:
    document = {**json.loads(EXAMPLE.read_text()), "unexplained": None}
    message = gap_message(document, Time(), [], "diagnosis")
    assert (message.unexplained_joint, message.unexplained_where) == ("", "")
    assert isnan(message.unexplained_share)


@pytest.mark.parametrize("case", CASES)
def test_every_verdict_becomes_a_message(case: Case) -> None:
    result = sample_gap(case=case, given=case != "none", tracking=case != "both")
    message = gap_message(gap_document(result), Time(), [], "diagnosis")
    assert (message.verdict, message.summary) == (result.verdict, result.summary)
    assert [each.sentence for each in message.causes] == [each.sentence for each in result.causes]
    assert [each.joint for each in message.joints] == list(result.joints)
    assert [each.stage for each in message.stages] == [each.name for each in result.stages]
    assert len(message.regimes) == len(result.regimes)
    assert (message.unexplained_joint == "") == (result.unexplained is None)


@pytest.mark.parametrize("key", ["verdict", "causes", "unexplained", "where", "stages"])
def test_document_without_a_key_is_one_line(key: str) -> None:
    document = json.loads(EXAMPLE.read_text())
    del document[key]
    with pytest.raises(DataError, match=f"diagnosis/gap.json: cannot be sent.*{key}"):
        gap_message(document, Time(), [], "diagnosis")


def test_last_diagnosis_is_latched_and_survives_a_restart(
    results: Path, observer, identifier
) -> None:
    GapPublisher(observer.node, results).add(7_000_000_000, ["a.mcap"], "diagnosis")
    assert str(identifier().latched("gap", GapReport)) == str(report(results))


@pytest.mark.parametrize("text", ["{", "[]", '{"format": "idim_iv_ros/last_gap/1"}'])
def test_damaged_record_of_the_last_diagnosis_is_a_warning(
    results: Path, text: str, observer, monkeypatch
) -> None:
    (results / "last_gap.json").write_text(text)
    publisher = GapPublisher(observer.node, results)
    publisher.publish_last()
    assert publisher.last is None
