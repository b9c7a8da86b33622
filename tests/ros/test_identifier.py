"""What a user of the identifier relies on, from one that the tests share; the last ones end it."""

import json
import os
import shutil
import signal
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pytest
from action_msgs.msg import GoalStatus
from rclpy.action import ActionClient

from idim_iv_interfaces.action import Diagnose as DiagnoseAction
from idim_iv_interfaces.msg import BagClosed, DriftReport, GapReport, ParameterEstimates
from idim_iv_interfaces.srv import Diagnose, GetHistory, SetBaseline
from tests.ros.conftest import ARM2, start_identifier
from tests.ros.identifier_client import IdentifierClient, require_truth
from tests.ros.processes import HANG, Observer

OK, WARN, ERROR = 0, 1, 2
BOTH = ("bag-1.mcap", "bag-2.mcap")
ANNOUNCED = "recorder/bag_closed:=/announced"


@pytest.fixture(scope="module")
def served(
    simulated_bags: Path, tmp_path_factory: pytest.TempPathFactory, observer: Observer
) -> Iterator[IdentifierClient]:
    """An identifier whose parameters the tests leave as they were."""
    folder = tmp_path_factory.mktemp("served")
    with ExitStack() as stack:
        yield start_identifier(stack, folder, observer, ANNOUNCED, bag_directory=simulated_bags)


@pytest.fixture(scope="module")
def truth(simulated_bags: Path) -> dict[str, float]:
    values = json.loads((simulated_bags / "bag.truth.json").read_text())
    return {name: value for name, value in values.items() if name != "format"}


def results(client: IdentifierClient) -> Path:
    return client.process.errors.parent / "results"


def test_service_answers_with_the_result_and_publishes_it_latched(served, truth) -> None:
    answer = served.identify("bag-1.mcap")
    assert answer.success, answer.message
    result = answer.result
    require_truth(result.parameters, truth)
    assert list(result.parameters.bags) == ["bag-1.mcap"]
    covariance = np.reshape(result.parameters.covariance, (len(truth), len(truth)))
    stds = [parameter.std for parameter in result.parameters.estimates]
    assert np.allclose(np.sqrt(np.diag(covariance)), stds)
    assert np.abs(covariance - np.diag(np.diag(covariance))).max() > 0.0
    document = json.loads((results(served) / result.files[0]).read_text())
    assert [p.value for p in result.parameters.estimates] == [
        p["value"] for p in document["parameters"]
    ]
    assert [(t.scope, t.p_value) for t in result.specification] == [
        (t["scope"], t["p_value"]) for t in document["specification"]["tests"]
    ]
    assert "joint_2: speed" in {t.scope for t in result.specification}
    assert result.instruments_source == document["instruments"]["source"]
    assert result.parameters.convergence_note == document["convergence_note"]
    assert (results(served) / result.files[1]).read_text().startswith("<!DOCTYPE html>")
    # As text: a NaN is not equal to itself.
    assert str(served.latched()) == str(result)
    assert str(served.latched("estimates", ParameterEstimates)) == str(result.parameters)
    served.observer.until(lambda: served.diagnosis("joint_2")[1], "the verdicts")
    for residual in result.residuals:
        wanted = {"valid": OK, "misspecified": ERROR}.get(residual.verdict, WARN)
        assert served.diagnosis(residual.joint) == (wanted, residual.sentence)
    ready = f"ready: {ARM2}; identifies on request, from bags in "
    assert ready in served.process.errors.read_text()


def test_action_gives_feedback_and_the_same_estimates(served, truth) -> None:
    feedback: list = []
    goal = served.goal("bag-2.mcap", feedback=feedback)
    assert goal.accepted
    answer = served.wait(goal.get_result_async())
    assert (answer.status, answer.result.success) == (GoalStatus.STATUS_SUCCEEDED, True)
    result = answer.result.result
    require_truth(result.parameters, truth)
    served.observer.until(lambda: feedback[-1].stage == "writing", "the last stage")
    assert {item.stage for item in feedback} >= {"reading", "regressor", "validation", "writing"}
    shares = [item.progress for item in feedback]
    assert shares == sorted(shares)
    assert 0.0 <= shares[0] < shares[-1] <= 1.0
    assert str(served.latched()) == str(result)


def test_calls_are_answered_while_a_job_runs_and_a_cancelled_one_leaves_nothing(served) -> None:
    before = set(results(served).rglob("*"))
    with served.parameters(when_busy="refuse"), served.closed_gate():
        goal = served.goal(*BOTH)
        worker = served.job()
        os.kill(worker, 0)
        assert served.parameter("when_busy").string_value == "refuse"
        assert "when_busy" in served.identify("bag-2.mcap").message
        assert served.wait(goal.cancel_goal_async()).goals_canceling
        answer = served.wait(goal.get_result_async())
    assert (answer.status, answer.result.message) == (GoalStatus.STATUS_CANCELED, "cancelled")
    with pytest.raises(ProcessLookupError):
        os.kill(worker, 0)
    assert set(results(served).rglob("*")) == before


def test_requests_wait_for_each_other_and_a_waiting_goal_can_be_cancelled(served) -> None:
    with served.parameters(queue_limit=2):
        with served.closed_gate():
            first = served.ask("bag-1.mcap", estimator="idim-ls")
            served.job()
            assert "0.1 s: 1 job" in served.identify("bag-2.mcap", timeout=0.1).message
            feedback: list = []
            goal = served.goal("bag-1.mcap", feedback=feedback)
            third = served.ask("bag-2.mcap", estimator="idim-ls")
            assert "2 jobs" in served.identify("bag-2.mcap").message
            served.observer.until(lambda: feedback, "word of the goal that waits")
            assert served.wait(goal.cancel_goal_async()).goals_canceling
            assert served.wait(goal.get_result_async()).status == GoalStatus.STATUS_CANCELED
            assert {item.stage for item in feedback} == {"waiting"}
        assert list(served.wait(first).result.parameters.bags) == ["bag-1.mcap"]
        last = served.wait(third).result.parameters
        assert (list(last.bags), last.estimator, last.iterations) == (["bag-2.mcap"], "idim-ls", 0)
    served.observer.until(lambda: "σ" in served.diagnosis("drift")[1], "the comparison")
    level, sentence = served.diagnosis("drift")
    assert level == OK, sentence
    assert "bag-1.mcap" in sentence


def test_limits_of_a_job_are_one_line(served) -> None:
    for words, limit in (
        ("not enough memory", {"memory_limit": 100_000_000}),
        ("max_bag_size", {"max_bag_size": 1000}),
    ):
        with served.parameters(**limit):
            answer = served.identify(*BOTH)
            assert not answer.success
            assert words in answer.message


def test_a_process_that_was_killed_is_said(served) -> None:
    with served.closed_gate():
        waiting = served.ask(*BOTH)
        os.kill(served.job(), signal.SIGKILL)
        answer = served.wait(waiting)
        assert (answer.success, answer.message) == (False, "the worker was ended by SIGKILL")


@pytest.mark.parametrize(
    ("request_", "words"),
    [
        ({"bags": []}, "at least one bag"),
        ({"bags": ["../bag-1.mcap"]}, "'..' is not allowed"),
        ({"bags": ["/etc/passwd"]}, "leads out of bag_directory"),
        ({"bags": ["broken.mcap"]}, "broken.mcap"),
        ({"bags": ["bag.truth.json"]}, "not a bag"),
        ({"configuration": "../config/arm2.yaml"}, "'..' is not allowed"),
        ({"configuration": "/etc/hostname"}, "leads out of the folder of the configuration"),
        ({"configuration": "arm2.urdf"}, "arm2.urdf"),
        ({"estimator": "best"}, "neither idim-iv nor idim-ls"),
        ({"timeout": -1.0}, "is no time"),
        ({"timeout": float("nan")}, "is no time"),
        ({"without": ["phlogiston"]}, "'phlogiston' is no effect"),
    ],
)
def test_bad_request_is_one_line(served, simulated_bags: Path, request_, words: str) -> None:
    (simulated_bags / "broken.mcap").write_bytes(b"\x89MCAP0\r\n" + bytes(1000))
    request = {"bags": ["bag-1.mcap"], **request_}
    if "without" in request:
        answer = served.call("diagnose", Diagnose, **request)
    else:
        answer = served.identify(*request.pop("bags"), **request)
    assert not answer.success
    assert words in answer.message
    assert "\n" not in answer.message
    assert "Traceback" not in served.process.errors.read_text()


def test_announced_bag_is_identified(served, simulated_bags: Path) -> None:
    served.identify("bag-1.mcap")
    publisher = served.node.create_publisher(BagClosed, "/announced", 10)
    served.observer.until(lambda: publisher.get_subscription_count() == 1, "the identifier")
    with served.parameters(auto=True):
        publisher.publish(BagClosed(bag="/etc/passwd", complete=True))
        served.observer.until(lambda: "/etc/passwd" in served.failure(), "the refusal")
        publisher.publish(BagClosed(bag=str(simulated_bags / "bag-2.mcap"), complete=True))
        served.observer.until(
            lambda: list(served.latched().parameters.bags) == ["bag-2.mcap"], "the result"
        )
    served.node.destroy_publisher(publisher)


def test_configuration_is_read_anew_when_it_is_set(served, tmp_path: Path) -> None:
    path = tmp_path / "arm.yaml"
    text = ARM2.read_text().replace("urdf: ", f"urdf: {ARM2.parent}/")
    path.write_text(text)
    with served.parameters(configuration=str(path)):
        path.write_text(text + "nonsense: 1\n")
        refused = served.set(configuration=str(path))
        assert not refused.successful
        assert refused.reason == f"configuration: {path}: unknown key nonsense"
        path.write_text(text.replace("joint_states: joint_states", "joint_states: joint states"))
        assert "'joint states' is no topic of ROS" in served.set(configuration=str(path)).reason
        path.write_text(text + "identification:\n  friction: [viscous, coulomb]\n")
        assert served.set(configuration=str(path)).successful
        result = served.identify("bag-1.mcap", estimator="idim-ls").result
    names = [parameter.name for parameter in result.parameters.estimates]
    assert "Fc1" in names
    assert "off1" not in names


def test_diagnosis_is_answered_with_the_report_and_published_latched(served) -> None:
    answer = served.call("diagnose", Diagnose, bags=list(BOTH), without=["backlash"])
    assert answer.success, answer.message
    report = answer.result
    assert (tuple(report.bags), list(report.without)) == (BOTH, ["backlash"])
    document = json.loads((results(served) / report.files[0]).read_text())
    assert (report.verdict, report.summary) == (document["verdict"], document["summary"])
    assert [joint.joint for joint in report.joints] == document["joints"]
    assert str(served.latched("gap", GapReport)) == str(report)


def test_diagnosis_by_action_gives_feedback_and_can_be_cancelled(served, stack) -> None:
    action = ActionClient(served.node, DiagnoseAction, f"/{served.name}/diagnose_bags")
    stack.callback(action.destroy)
    served.observer.until(action.server_is_ready, "the action")
    served.observer.be_heard(f"/{served.name}")
    stages: list[str] = []
    request = DiagnoseAction.Goal(bags=["bag-1.mcap"])
    with served.closed_gate("reading"):
        goal = served.wait(
            action.send_goal_async(request, lambda heard: stages.append(heard.feedback.stage))
        )
        served.job()
        served.observer.until(lambda: "reading" in stages, "its word")
        assert served.wait(goal.cancel_goal_async()).goals_canceling
        assert served.wait(goal.get_result_async()).status == GoalStatus.STATUS_CANCELED


def test_results_survive_a_kill_and_an_interrupted_node_answers(
    served, simulated_bags: Path, observer: Observer, stack: ExitStack
) -> None:
    """The last of the file: it ends the node that they share."""
    first = served.identify("bag-1.mcap").result
    other = served.identify("bag-2.mcap", estimator="idim-ls").result
    assert other.parameters.estimator == "idim-ls"
    assert served.call("set_baseline", SetBaseline, folder="").success
    refused = served.call("set_baseline", SetBaseline, folder="nowhere").message
    assert "no identification in nowhere" in refused
    before = served.call("get_history", GetHistory, estimator="").identifications
    with served.closed_gate():
        served.goal(*BOTH)
        worker = served.job()
        served.process.kill()
        observer.until(lambda: not served.process_exists(worker), "the end of the worker")
    # A diagnosis that was kept.
    kept = results(served) / "diagnosis_3000"
    kept.mkdir()
    shutil.copy(Path(__file__).with_name("gap.json"), kept / "gap.json")
    later = 2**31 - 8
    os.utime(kept / "gap.json", (later, later))
    folder = served.process.errors.parent
    client = start_identifier(stack, folder, observer, bag_directory=simulated_bags)
    # Another estimator leaves the result that is published.
    assert str(client.latched()) == str(first)
    gap = client.latched("gap", GapReport)
    assert (gap.header.stamp.sec, list(gap.bags)) == (later, ["bag-1.mcap"])
    assert (gap.verdict, gap.files[0]) == ("structural", "diagnosis_3000/gap.json")
    compared = client.latched("drift", DriftReport).comparisons
    assert {entry.estimator for entry in compared} == {"idim-iv", "idim-ls"}
    assert client.call("get_history", GetHistory, estimator="").identifications == before
    of_one = client.call("get_history", GetHistory, estimator="idim-iv").identifications
    assert [list(entry.bags) for entry in of_one if entry.baseline] == [["bag-1.mcap"]]
    assert {entry.estimator for entry in of_one} == {"idim-iv"}
    with client.closed_gate():
        future = client.goal(*BOTH).get_result_async()
        worker = client.job()
        client.parameter("auto")  # answered after the question for the result has arrived
        client.process.process.send_signal(signal.SIGINT)
        answer = client.wait(future)
    assert answer.status == GoalStatus.STATUS_ABORTED
    assert answer.result.message == "the identifier was shut down"
    assert client.process.process.wait(HANG) == 0
    with pytest.raises(ProcessLookupError):
        os.kill(worker, 0)
    assert "Traceback" not in client.process.errors.read_text()
