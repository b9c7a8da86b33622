"""What a user of the identifier relies on."""

import json
import os
import shutil
import signal
import sys
from pathlib import Path

import numpy as np
import pytest
from action_msgs.msg import GoalStatus

from idim_iv_interfaces.msg import DriftReport, GapReport, ParameterEstimates
from idim_iv_interfaces.srv import GetHistory, SetBaseline
from idim_iv_ros import load_configuration
from idim_iv_ros.excitation import random_motion
from idim_iv_ros.simulators.recording import simulate
from tests.ros.conftest import ARM2
from tests.ros.identifier_client import IdentifierClient
from tests.ros.processes import HANG, Process
from tests.ros.true_parameters import require_truth

OK, WARN, ERROR = 0, 1, 2
EXAMPLE = Path(__file__).with_name("gap.json")


@pytest.fixture(scope="module")
def truth(simulated_bags: Path) -> dict[str, float]:
    values = json.loads((simulated_bags / "bag.truth.json").read_text())
    return {name: value for name, value in values.items() if name != "format"}


def results(client) -> Path:
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
    tests = document["specification"]["tests"]
    assert [(t.scope, t.p_value) for t in result.specification] == [
        (t["scope"], t["p_value"]) for t in tests
    ]
    assert "joint_2: speed" in {t.scope for t in result.specification}
    assert result.instruments_source == document["instruments"]["source"]
    assert result.parameters.convergence_note == document["convergence_note"]
    assert (results(served) / result.files[1]).read_text().startswith("<!DOCTYPE html>")
    # As text: a NaN is not equal to itself.
    assert str(served.latched()) == str(result)
    assert str(served.latched("estimates", ParameterEstimates)) == str(result.parameters)
    served.observer.until(lambda: "joint_2" in served.diagnostics, "the verdicts")
    for residual in result.residuals:
        level, sentence, _ = served.diagnostics[residual.joint]
        wanted = {"valid": OK, "misspecified": ERROR}.get(residual.verdict, WARN)
        assert (level, sentence) == (wanted, residual.sentence)


def test_action_gives_feedback_and_the_same_estimates(served, truth) -> None:
    feedback: list = []
    goal = served.goal("bag-2.mcap", feedback=feedback)
    assert goal.accepted
    answer = served.wait(goal.get_result_async())
    assert (answer.status, answer.result.success) == (GoalStatus.STATUS_SUCCEEDED, True)
    result = answer.result.result
    require_truth(result.parameters, truth)
    served.observer.until(lambda: feedback[-1].stage == "writing", "the last stage")
    stages = [item.stage for item in feedback]
    for stage in ("reading", "regressor", "validation", "writing"):
        assert stage in stages
    shares = [item.progress for item in feedback]
    assert shares == sorted(shares)
    assert 0.0 <= shares[0] < shares[-1] <= 1.0
    assert str(served.latched()) == str(result)


def test_cancelled_goal_ends_and_its_worker_is_gone(served) -> None:
    before = set(results(served).rglob("*"))
    with served.closed_gate():
        goal = served.goal("bag-1.mcap", "bag-2.mcap")
        worker = served.job()
        os.kill(worker, 0)
        assert served.wait(goal.cancel_goal_async()).goals_canceling
        answer = served.wait(goal.get_result_async())
    assert (answer.status, answer.result.message) == (GoalStatus.STATUS_CANCELED, "cancelled")
    with pytest.raises(ProcessLookupError):
        os.kill(worker, 0)
    assert set(results(served).rglob("*")) == before


def test_calls_are_answered_while_a_job_runs(served) -> None:
    with served.parameters(when_busy="refuse"), served.closed_gate():
        goal = served.goal("bag-1.mcap", "bag-2.mcap")
        served.job()
        assert served.parameter("when_busy").string_value == "refuse"
        refused = served.identify("bag-2.mcap")
        assert "when_busy" in refused.message
        assert served.wait(goal.cancel_goal_async()).goals_canceling
        served.wait(goal.get_result_async())


def test_requests_wait_for_each_other_and_a_waiting_goal_can_be_cancelled(served) -> None:
    with served.parameters(queue_limit=2):
        with served.closed_gate():
            first = served.ask("bag-1.mcap", estimator="idim-ls")
            served.job()
            late = served.identify("bag-2.mcap", timeout=0.1)
            assert "0.1 s: 1 job" in late.message
            feedback: list = []
            goal = served.goal("bag-1.mcap", feedback=feedback)
            third = served.ask("bag-2.mcap", estimator="idim-ls")
            refused = served.identify("bag-2.mcap")
            assert "2 jobs" in refused.message
            served.observer.until(lambda: feedback, "word of the goal that waits")
            assert served.wait(goal.cancel_goal_async()).goals_canceling
            assert served.wait(goal.get_result_async()).status == GoalStatus.STATUS_CANCELED
            assert {item.stage for item in feedback} == {"waiting"}
        assert list(served.wait(first).result.parameters.bags) == ["bag-1.mcap"]
        last = served.wait(third).result.parameters
        assert (list(last.bags), last.estimator, last.iterations) == (["bag-2.mcap"], "idim-ls", 0)
    served.observer.until(lambda: "σ" in served.diagnostics["drift"][1], "the comparison")
    level, sentence, _ = served.diagnostics["drift"]
    assert level == OK, sentence
    assert "bag-1.mcap" in sentence


def test_what_was_found_survives_a_kill_and_an_interrupted_node_answers(
    identifier, observer, tmp_path: Path
) -> None:
    client = identifier()
    first = client.identify("bag-1.mcap").result
    other = client.identify("bag-2.mcap", estimator="idim-ls").result
    assert other.parameters.estimator == "idim-ls"
    history = client.call("get_history", GetHistory, estimator="")
    assert [entry.estimator for entry in history.identifications] == ["idim-iv", "idim-ls"]
    assert client.call("set_baseline", SetBaseline, folder="").success
    refused = client.call("set_baseline", SetBaseline, folder="nowhere").message
    assert "no identification in nowhere" in refused
    with client.closed_gate():
        client.goal("bag-1.mcap", "bag-2.mcap")
        worker = client.job()
        client.process.kill()
        observer.until(lambda: not client.process_exists(worker), "the end of the worker")
    # A diagnosis that was kept.
    (tmp_path / "results" / "diagnosis").mkdir()
    shutil.copy(EXAMPLE, tmp_path / "results" / "diagnosis" / "gap.json")
    record = {"format": "idim_iv_ros/last_gap/1", "stamp": 7 * 10**9, "bags": ["a.mcap"]}
    record = json.dumps({**record, "folder": "diagnosis"})
    (tmp_path / "results" / "last_gap.json").write_text(record)
    client = identifier()
    # Another estimator leaves the result that is published.
    assert str(client.latched()) == str(first)
    gap = client.latched("gap", GapReport)
    assert (gap.header.stamp.sec, list(gap.bags), gap.verdict) == (7, ["a.mcap"], "structural")
    report = client.latched("drift", DriftReport)
    assert not report.drifting
    assert [entry.estimator for entry in report.comparisons] == ["idim-iv", "idim-ls"]
    history = client.call("get_history", GetHistory, estimator="idim-iv")
    assert [entry.baseline for entry in history.identifications] == [True]
    with client.closed_gate():
        goal = client.goal("bag-1.mcap", "bag-2.mcap")
        worker = client.job()
        future = goal.get_result_async()
        client.parameter("auto")  # answered after the question for the result has arrived
        client.process.process.send_signal(signal.SIGINT)
        answer = client.wait(future)
    assert answer.status == GoalStatus.STATUS_ABORTED
    assert answer.result.message == "the identifier was shut down"
    assert client.process.process.wait(HANG) == 0
    with pytest.raises(ProcessLookupError):
        os.kill(worker, 0)
    assert "Traceback" not in client.process.errors.read_text()


def test_idim_iv_serve_is_the_identifier_and_flags_a_changed_parameter(
    simulated_bags: Path, tmp_path: Path, stack, observer
) -> None:
    text = ARM2.read_text().replace("urdf: ", f"urdf: {ARM2.parent}/")
    worn = tmp_path / "worn.yaml"
    worn.write_text(text.replace("Fc1: 1.5012", "Fc1: 1.8012"))
    configuration = load_configuration(worn)
    motion = random_motion(configuration, duration=10.0, rate=1000.0, seed=1)
    simulate(configuration, tmp_path / "worn.mcap", motion)
    (tmp_path / "first.mcap").write_bytes((simulated_bags / "bag-1.mcap").read_bytes())
    command = [str(Path(sys.executable).parent / "idim-iv"), "serve", "--config", str(ARM2)]
    folders = ["--bags", str(tmp_path), "--out", str(tmp_path / "out")]
    process = Process([*command, *folders], tmp_path, "identifier")
    stack.callback(process.end)
    client = IdentifierClient(observer, process)
    stack.callback(client.close)
    for bag in ("first.mcap", "worn.mcap"):
        assert client.identify(bag, estimator="idim-ls").success
    assert len(list((tmp_path / "out").glob("*/result.json"))) == 2
    observer.until(lambda: client.diagnostics["drift"][0] == WARN, "the drift")
    _, sentence, values = client.diagnostics["drift"]
    assert sentence.endswith("changed since first.mcap")
    statistics = {key: float(value) for key, value in values.items() if key.endswith(" (σ)")}
    limit = statistics.pop("limit (σ)")
    flagged = {key for key, value in statistics.items() if abs(value) > limit}
    assert flagged == {"Fc1 (σ)"}
    assert process.finish() == 0


def test_limits_of_a_job_are_one_line(served) -> None:
    with served.parameters(memory_limit=100_000_000):
        answer = served.identify("bag-1.mcap", "bag-2.mcap")
        assert not answer.success
        assert answer.message.startswith("not enough memory"), answer.message
    with served.parameters(max_bag_size=1000):
        answer = served.identify("bag-1.mcap")
        assert not answer.success
        assert "max_bag_size" in answer.message


def test_full_disk_is_one_line_and_the_node_goes_on(identifier, small_disk: Path) -> None:
    client = identifier(output_directory=small_disk / "results")
    ballast = small_disk / "ballast"
    ballast.write_bytes(bytes(os.statvfs(small_disk).f_bavail * 4096 - 8192))
    answer = client.identify("bag-1.mcap", estimator="idim-ls")
    assert not answer.success
    assert "No space left on device" in answer.message
    assert "\n" not in answer.message
    assert client.failure().endswith(answer.message)
    ballast.unlink()
    assert client.identify("bag-1.mcap", estimator="idim-ls").success
    assert "Traceback" not in client.process.errors.read_text()


def kept_process(client: IdentifierClient) -> int:
    """Process id of the worker that is kept: the only child of the node."""
    node = client.process.process.pid
    (child,) = Path(f"/proc/{node}/task/{node}/children").read_text().split()
    return int(child)


def test_next_job_works_after_its_process_or_the_kept_one_was_killed(served) -> None:
    for kept in (False, True):
        with served.closed_gate():
            waiting = served.ask("bag-1.mcap", "bag-2.mcap")
            job = served.job()
            os.kill(kept_process(served) if kept else job, signal.SIGKILL)
            answer = served.wait(waiting)
            assert (answer.success, answer.message) == (False, "the worker was ended by SIGKILL")
            served.observer.until(lambda: not served.process_exists(job), "its end")  # noqa: B023
    assert served.identify("bag-1.mcap", estimator="idim-ls").success


def test_jobs_follow_each_other_without_a_start(served) -> None:
    kept = kept_process(served)
    for _ in range(2):
        assert served.identify("bag-1.mcap", estimator="idim-ls").success
        assert kept_process(served) == kept


def test_job_of_a_client_that_is_gone_is_cancelled_and_until_then_it_hears_of_it(served) -> None:
    feedback: list = []
    with served.closed_gate():
        served.goal("bag-1.mcap", "bag-2.mcap", feedback=feedback)
        worker = served.job()
        heard = len(feedback)
        served.observer.until(lambda: len(feedback) >= heard + 2, "signs of life")
        served.action.destroy()
        try:
            served.observer.until(lambda: not served.process_exists(worker), "the end of the job")
        finally:
            served.connect()
    assert "who asked is gone" in served.process.errors.read_text()
