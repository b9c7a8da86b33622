"""The identifier asked for a diagnosis."""

import json

import pytest
from action_msgs.msg import GoalStatus
from rclpy.action import ActionClient

from idim_iv_interfaces.action import Diagnose as DiagnoseAction
from idim_iv_interfaces.msg import GapReport
from idim_iv_interfaces.srv import Diagnose


@pytest.fixture
def service(served):
    client = served.node.create_client(Diagnose, f"/{served.name}/diagnose")
    served.observer.until(client.service_is_ready, "the service")
    served.observer.be_heard(f"/{served.name}")
    yield client
    served.node.destroy_client(client)


@pytest.fixture
def action(served):
    client = ActionClient(served.node, DiagnoseAction, f"/{served.name}/diagnose_bags")
    served.observer.until(client.server_is_ready, "the action")
    served.observer.be_heard(f"/{served.name}")
    yield client
    client.destroy()


def test_service_answers_with_the_report_and_publishes_it_latched(served, service) -> None:
    request = Diagnose.Request(bags=["bag-1.mcap", "bag-2.mcap"], without=["backlash"])
    answer = served.wait(service.call_async(request))
    assert answer.success, answer.message
    report = answer.result
    assert list(report.bags) == ["bag-1.mcap", "bag-2.mcap"]
    assert list(report.without) == ["backlash"]
    results = served.process.errors.parent / "results"
    document = json.loads((results / report.files[0]).read_text())
    assert (report.verdict, report.summary) == (document["verdict"], document["summary"])
    assert [joint.joint for joint in report.joints] == document["joints"]
    assert str(served.latched("gap", GapReport)) == str(report)


def test_action_gives_feedback_and_a_goal_can_be_cancelled(served, action) -> None:
    stages: list[str] = []
    with served.closed_gate("reading"):
        goal = served.wait(
            action.send_goal_async(
                DiagnoseAction.Goal(bags=["bag-1.mcap"]),
                lambda message: stages.append(message.feedback.stage),
            )
        )
        served.job()
        served.observer.until(lambda: "reading" in stages, "its word")
        assert served.wait(goal.cancel_goal_async()).goals_canceling
        assert served.wait(goal.get_result_async()).status == GoalStatus.STATUS_CANCELED


@pytest.mark.parametrize(
    ("request_", "words"),
    [
        ({"bags": []}, "at least one bag"),
        ({"bags": ["../bag-1.mcap"]}, "'..' is not allowed"),
        ({"without": ["phlogiston"]}, "'phlogiston' is no effect"),
        ({"without": ["backlash"] * 101}, "101 effects; at most 100"),
        ({"timeout": -1.0}, "is no time"),
    ],
)
def test_bad_request_is_one_line(served, service, request_, words: str) -> None:
    request = Diagnose.Request(**{"bags": ["bag-1.mcap"], **request_})
    answer = served.wait(service.call_async(request))
    assert not answer.success
    assert words in answer.message
    assert "\n" not in answer.message
