"""A client that asks 200 times before it looks at the first answer gets them all."""

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import rclpy
from rclpy.action import ActionClient
from rclpy.action.server import ActionServer
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter

from idim_iv_interfaces.action import Identify as IdentifyAction
from idim_iv_interfaces.srv import Identify
from idim_iv_ros.nodes.identifier import job_queue, request_server
from idim_iv_ros.nodes.identifier.node import Identifier
from tests.ros.conftest import ARM2
from tests.ros.processes import Observer

COUNT = 200
HANG = 120.0  # s


class EndsAtOnce:
    """A worker whose jobs have ended when they have begun."""

    process_id, ready, killed = None, True, False

    def __init__(self, heard: Callable) -> None:
        self._heard = heard

    def begin(self, request: object) -> None:
        self._heard(self, {"error": "nothing moves"})
        self._heard(self, {"ended": 1})

    def close(self) -> None:
        """Nothing is left."""


class Answering:
    """An identifier in this process; its turns are given by the test, and its answers counted."""

    def __init__(self, identifier: Identifier) -> None:
        self.node = identifier.node
        self.executor = SingleThreadedExecutor()
        self.executor.add_node(self.node)
        server = identifier._servers[0]
        self.goals = server._actions._goals_paced
        self.results = server._actions._results_paced
        self.calls = server._paced
        self.submitted = self.results_sent = 0

    def until(self, holds: Callable[[], bool]) -> None:
        """Let the identifier work, and the client not."""
        for _ in range(100 * COUNT):
            if holds():
                return
            self.executor.spin_once(timeout_sec=0.01)
        raise AssertionError("not all requests were taken")


@pytest.fixture
def answering(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Answering]:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(job_queue, "Worker", EndsAtOnce)
    monkeypatch.setattr(request_server, "_PAUSE", 3600.0)
    submit, send = Identifier._submit, ActionServer._send_result_response

    def submitted(self: Identifier, *request: object) -> object:
        answering.submitted += 1
        return submit(self, *request)

    def sent(*result: object) -> None:
        answering.results_sent += 1
        send(*result)

    monkeypatch.setattr(Identifier, "_submit", submitted)
    monkeypatch.setattr(ActionServer, "_send_result_response", sent)
    (tmp_path / "bag.mcap").write_bytes(bytes(100))
    identifier = Identifier()
    answering = Answering(identifier)
    results = identifier.node.set_parameters([Parameter("configuration", value=str(ARM2))])
    assert results[0].successful
    yield answering
    identifier.close()


def all_answers(
    answering: Answering,
    paced: request_server.PacedAnswers,
    sent: Callable[[], int],
    futures: list[rclpy.Future],
    observer: Observer,
) -> list:
    """Let the identifier take all requests before the client looks, then answer turn by turn."""
    answering.until(lambda: sent() + len(paced._waiting) == COUNT)
    assert sent() < 10
    while True:
        observer.until(lambda: sum(each.done() for each in futures) == sent(), "answers", HANG)
        if sent() == COUNT:
            return [each.result() for each in futures]
        turn = min(sent() + 5, COUNT)
        paced._next_turn()
        answering.until(lambda: sent() == turn)  # noqa: B023


def test_all_of_200_goals_are_answered(answering: Answering, observer: Observer) -> None:
    client = ActionClient(observer.node, IdentifyAction, "/identifier/identify")
    observer.until(client.server_is_ready, "the action", HANG)
    sent = [client.send_goal_async(IdentifyAction.Goal(bags=["bag.mcap"])) for _ in range(COUNT)]
    goals = all_answers(answering, answering.goals, lambda: answering.submitted, sent, observer)
    assert all(goal.accepted for goal in goals)
    asked = [goal.get_result_async() for goal in goals]
    results = all_answers(
        answering, answering.results, lambda: answering.results_sent, asked, observer
    )
    messages = {each.result.message for each in results}
    assert messages <= {"nothing moves", "busy: 10 jobs wait already"}
    client.destroy()


def test_all_of_200_service_calls_are_answered(answering: Answering, observer: Observer) -> None:
    client = observer.node.create_client(Identify, "/identifier/identify")
    observer.until(client.service_is_ready, "the service", HANG)
    asked = [client.call_async(Identify.Request(bags=["missing"])) for _ in range(COUNT)]
    paced = answering.calls
    answers = all_answers(
        answering, paced, lambda: answering.submitted - len(paced._waiting), asked, observer
    )
    assert all("no such bag" in answer.message for answer in answers)
    observer.node.destroy_client(client)


def test_one_request_is_answered_at_once_and_the_pace_ends_with_the_node(
    observer: Observer, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(request_server, "_PAUSE", 3600.0)
    paced, gone = request_server.PacedAnswers(observer.node), []
    for number in range(20):
        paced(lambda: gone.append(number))  # noqa: B023
    assert len(gone) == 5
    paced._next_turn()
    assert len(gone) == 10
    paced.hurry()
    assert len(gone) == 20
