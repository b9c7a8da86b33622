"""What a user of the identifier relies on."""

import json
import os
import time
from pathlib import Path

import numpy as np
import pytest
from action_msgs.msg import GoalStatus
from scipy.stats import binom

from idim_iv_interfaces.msg import ParameterEstimates
from idim_iv_interfaces.srv import Diagnose

OK, WARN, ERROR = 0, 1, 2
PROMPT = 0.2  # s


def outside(estimates: ParameterEstimates, truth: dict[str, float]) -> dict[str, float]:
    """Parameters more than three standard deviations off, with how many."""
    found = {p.name: (p.value - truth[p.name]) / p.std for p in estimates.estimates}
    assert set(found) == set(truth)
    return {name: off for name, off in found.items() if abs(off) > 3.0}


def allowed(parameters: int) -> int:
    """How many of so many may be off by more than 3 σ (probability 0.27 %), at a level of 1e-3."""
    return int(binom.isf(1e-3, parameters, 0.0027))


def test_service_answers_with_the_result_and_publishes_it_latched(
    identifier, simulated_bags: Path, tmp_path: Path
) -> None:
    client = identifier()
    answer = client.identify("bag-1.mcap")
    assert answer.success, answer.message
    result = answer.result
    truth = json.loads((simulated_bags / "bag.truth.json").read_text())
    found = outside(result.parameters, truth)
    assert len(found) <= allowed(len(truth)), found
    assert list(result.parameters.bags) == ["bag-1.mcap"]
    covariance = np.reshape(result.parameters.covariance, (len(truth), len(truth)))
    stds = [parameter.std for parameter in result.parameters.estimates]
    assert np.allclose(np.sqrt(np.diag(covariance)), stds)
    assert np.abs(covariance - np.diag(np.diag(covariance))).max() > 0.0
    document = json.loads((tmp_path / "results" / result.files[0]).read_text())
    assert [p.value for p in result.parameters.estimates] == [
        p["value"] for p in document["parameters"]
    ]
    assert (tmp_path / "results" / result.files[1]).read_text().startswith("<!DOCTYPE html>")
    assert client.latched() == result
    assert client.latched("estimates", ParameterEstimates) == result.parameters
    for residual in result.residuals:
        client.observer.until(lambda: "joint_2" in client.diagnostics, "the verdicts")
        level, sentence, _ = client.diagnostics[residual.joint]
        wanted = {"stands": OK, "model error here": ERROR}.get(residual.verdict, WARN)
        assert (level, sentence) == (wanted, residual.sentence)


def test_action_gives_feedback_and_the_same_result(identifier) -> None:
    client = identifier()
    feedback: list = []
    goal = client.goal("bag-1.mcap", estimator="idim-ls", feedback=feedback)
    assert goal.accepted
    answer = client.wait(goal.get_result_async())
    assert (answer.status, answer.result.success) == (GoalStatus.STATUS_SUCCEEDED, True)
    assert answer.result.result.parameters.estimator == "idim-ls"
    stages = [each.stage for each in feedback]
    for stage in ("reading", "regressor", "validation", "writing"):
        assert stage in stages
    shares = [each.progress for each in feedback]
    assert shares == sorted(shares)
    assert 0.0 <= shares[0] < shares[-1] <= 1.0
    again = client.identify("bag-1.mcap", estimator="idim-ls").result
    assert again.parameters.estimates == answer.result.result.parameters.estimates


def test_cancelled_goal_ends_within_a_second_and_its_worker_is_gone(
    identifier, tmp_path: Path
) -> None:
    client = identifier()
    goal = client.goal("bag-1.mcap", "bag-2.mcap")
    worker = client.worker()
    os.kill(worker, 0)
    begin = time.perf_counter()
    assert client.wait(goal.cancel_goal_async()).goals_canceling
    answer = client.wait(goal.get_result_async())
    assert time.perf_counter() - begin < 1.0
    assert (answer.status, answer.result.message) == (GoalStatus.STATUS_CANCELED, "cancelled")
    with pytest.raises(ProcessLookupError):
        os.kill(worker, 0)
    assert list((tmp_path / "results").iterdir()) == []
    assert client.identify("bag-1.mcap", estimator="idim-ls").success


def test_calls_are_answered_while_a_job_runs(identifier) -> None:
    client = identifier(when_busy="refuse")
    goal = client.goal("bag-1.mcap", "bag-2.mcap")
    client.worker()
    seconds = []
    for _ in range(5):
        value, taken = client.parameter("when_busy")
        assert value.string_value == "refuse"
        seconds.append(taken)
        begin = time.perf_counter()
        refused = client.identify("bag-2.mcap")
        seconds.append(time.perf_counter() - begin)
        assert refused.message == "busy with another identification; when_busy is refuse"
    assert max(seconds) < PROMPT
    assert client.wait(goal.cancel_goal_async()).goals_canceling


def test_requests_wait_for_each_other_and_a_waiting_goal_can_be_cancelled(identifier) -> None:
    client = identifier(queue_limit=2)
    first = client.ask("bag-1.mcap", estimator="idim-ls")
    client.worker()
    feedback: list = []
    goal = client.goal("bag-1.mcap", feedback=feedback)
    third = client.ask("bag-2.mcap", estimator="idim-ls")
    refused = client.identify("bag-2.mcap")
    assert refused.message == "busy: 2 identifications wait already"
    assert client.wait(goal.cancel_goal_async()).goals_canceling
    assert client.wait(goal.get_result_async()).status == GoalStatus.STATUS_CANCELED
    assert [each.stage for each in feedback] == ["waiting"]
    assert list(client.wait(first).result.parameters.bags) == ["bag-1.mcap"]
    assert list(client.wait(third).result.parameters.bags) == ["bag-2.mcap"]


def test_last_result_survives_a_kill(identifier) -> None:
    client = identifier()
    result = client.identify("bag-1.mcap", estimator="idim-ls").result
    client.process.kill()
    assert identifier().latched() == result


def test_worker_ends_with_its_node(identifier, observer) -> None:
    client = identifier()
    client.ask("bag-1.mcap", "bag-2.mcap")
    worker = client.worker()
    client.process.kill()

    def gone() -> bool:
        status = Path(f"/proc/{worker}/status")
        return not status.exists() or "State:\tZ" in status.read_text()

    observer.until(gone, "the end of the worker")


def test_job_that_takes_too_long_is_ended(identifier) -> None:
    answer = identifier().identify("bag-1.mcap", timeout=0.05)
    assert not answer.success
    assert answer.message == "ended after 0.05 s without a result"


def test_job_that_needs_too_much_memory_is_one_line(identifier) -> None:
    client = identifier(memory_limit=100_000_000)
    answer = client.identify("bag-1.mcap", "bag-2.mcap")
    assert not answer.success
    assert answer.message.startswith("not enough memory"), answer.message


def test_diagnosis_is_refused_in_one_line(identifier, observer) -> None:
    client = identifier()
    service = observer.node.create_client(Diagnose, f"/{client.name}/diagnose")
    observer.until(service.service_is_ready, "the service")
    answer = client.wait(service.call_async(Diagnose.Request(bags=["bag-1.mcap"])))
    observer.node.destroy_client(service)
    assert not answer.success
    assert answer.message == "diagnose is not part of this version: only identify is"
