"""A client that asks 200 times before it looks at the first answer gets them all."""

import functools
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import rclpy
from rclpy.action import ActionClient
from rclpy.action.server import ActionServer
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter

from idim_iv_interfaces.action import Identify as IdentifyAction
from idim_iv_ros.nodes.identifier import request_server
from idim_iv_ros.nodes.identifier.node import Identifier
from tests.ros.conftest import ARM2
from tests.ros.processes import Observer
from tests.ros.told_worker import EndsAtOnce

COUNT = 200


class Answering:
    """An identifier in this process; its turns are given by the test, and its answers counted."""

    def __init__(self, identifier: Identifier) -> None:
        self.node = identifier.node
        self.executor = SingleThreadedExecutor()
        self.executor.add_node(self.node)
        server = identifier._servers[0]
        self.goals = server._actions._goals_paced
        self.results = server._actions._results_paced
        self.submitted = self.results_sent = 0
        self.close = functools.cache(identifier.close)

    def until(self, condition: Callable[[], bool]) -> None:
        """Let the identifier work, and the client not."""
        for _ in range(100 * COUNT):
            if condition():
                return
            self.executor.spin_once(timeout_sec=0.01)
        raise AssertionError("not all requests were taken")


@pytest.fixture
def answering(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Answering]:
    monkeypatch.chdir(tmp_path)
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
    identifier = Identifier((), EndsAtOnce)
    answering = Answering(identifier)
    results = identifier.node.set_parameters([Parameter("configuration", value=str(ARM2))])
    assert results[0].successful
    yield answering
    answering.close()


def all_answers(
    answering: Answering,
    paced: request_server.PacedAnswers,
    sent: Callable[[], int],
    futures: list[rclpy.Future],
    observer: Observer,
) -> list:
    """Let the identifier take all requests before the client looks, then answer turn by turn."""
    answering.until(lambda: sent() + paced.waiting == COUNT)
    assert sent() < 10
    while True:
        observer.until(lambda: sum(future.done() for future in futures) == sent(), "answers")
        if sent() == COUNT:
            return [future.result() for future in futures]
        turn = min(sent() + 5, COUNT)
        paced._next_turn()
        answering.until(lambda: sent() == turn)  # noqa: B023


def test_all_of_200_goals_are_answered(answering: Answering, observer: Observer) -> None:
    client = ActionClient(observer.node, IdentifyAction, "/identifier/identify_bags")
    observer.until(client.server_is_ready, "the action")
    sent = [client.send_goal_async(IdentifyAction.Goal(bags=["bag.mcap"])) for _ in range(COUNT)]
    goals = all_answers(answering, answering.goals, lambda: answering.submitted, sent, observer)
    assert all(goal.accepted for goal in goals)
    asked = [goal.get_result_async() for goal in goals]
    results = all_answers(
        answering, answering.results, lambda: answering.results_sent, asked, observer
    )
    messages = {result.result.message for result in results}
    assert messages <= {"nothing moves", "busy: 10 jobs wait already"}
    client.destroy()


def test_some_requests_are_answered_at_once(
    observer: Observer, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(request_server, "_PAUSE", 3600.0)
    paced, gone = request_server.PacedAnswers(observer.node), []
    for number in range(20):
        paced(functools.partial(gone.append, number))
    assert gone == list(range(5))
    paced._next_turn()
    assert gone == list(range(10))
    assert paced.waiting == 10
