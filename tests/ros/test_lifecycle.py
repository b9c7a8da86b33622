"""The identifier as a managed node: configured and activated when it is asked to be."""

from collections.abc import Callable
from pathlib import Path

import pytest
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState

from idim_iv_ros.errors import UsageError
from idim_iv_ros.nodes.identifier.estimate_history import FolderLock
from tests.ros.conftest import ARM2, start_identifier
from tests.ros.identifier_client import IdentifierClient


def change(client: IdentifierClient, label: str) -> bool:
    return client.call("change_state", ChangeState, transition=Transition(label=label)).success


def state(client: IdentifierClient) -> str:
    return client.call("get_state", GetState).current_state.label


def log(client: IdentifierClient) -> str:
    return client.process.errors.read_text()


@pytest.fixture
def arm(robot_file: Callable[[str], Path]) -> Path:
    """A configuration that cannot be read yet."""
    return robot_file("robot:\n  joints: [a]\nnonsense: 1\n")


def test_requests_are_accepted_between_activation_and_deactivation(
    stack, tmp_path: Path, observer, simulated_bags: Path, arm: Path
) -> None:
    client = start_identifier(
        stack, tmp_path, observer, configuration=arm, autostart=False, bag_directory=simulated_bags
    )
    name = f"/{client.name}"
    assert state(client) == "unconfigured"
    assert client.identify("bag-1.mcap").message == (
        f"the identifier is unconfigured: call ros2 lifecycle set {name} configure, then "
        f"ros2 lifecycle set {name} activate"
    )
    # A file that cannot be read leaves it unconfigured, with the reason in the log.
    assert not change(client, "configure")
    assert state(client) == "unconfigured"
    assert f"cannot configure: parameter configuration: {arm}: unknown key nonsense" in log(client)
    arm.write_text("robot:\n  joints: [a]\nsignals:\n  joint_states: joint states\n")
    assert not change(client, "configure")
    assert f"configuration: {arm}: signals: 'joint states' is no topic of ROS" in log(client)
    # What this state does not have is answered too.
    assert not client.call(
        "change_state", ChangeState, transition=Transition(id=Transition.TRANSITION_ACTIVATE)
    ).success
    assert "transition 3" in log(client)
    arm.write_text(ARM2.read_text().replace("urdf: ", f"urdf: {ARM2.parent}/"))
    assert change(client, "configure")
    assert state(client) == "inactive"
    refused = client.identify("bag-1.mcap").message
    assert refused == f"the identifier is inactive: call ros2 lifecycle set {name} activate"
    observer.until(lambda: client.diagnostics["identification"][1] == "inactive", "its state")
    assert change(client, "activate")
    assert f"ready: {arm}; identifies on request" in log(client)
    with client.closed_gate():
        waiting = [client.ask("bag-1.mcap"), client.ask("bag-2.mcap")]
        client.job()
        client.parameter("auto")  # answered after the second request has arrived
        assert change(client, "deactivate")
        messages = {client.wait(item).message for item in waiting}
    assert messages == {"the identifier was deactivated"}
    # The file is read anew when it is configured again.
    arm.write_text("nonsense: 2\n")
    assert change(client, "activate") and change(client, "deactivate")
    assert change(client, "cleanup")
    assert not change(client, "configure")
    assert state(client) == "unconfigured"
    assert change(client, "shutdown")
    assert client.identify("bag-1.mcap").message == (
        "the identifier is finalized: start the node again"
    )
    assert client.process.finish() == 0
    assert "Traceback" not in log(client)


def test_a_folder_of_results_belongs_to_one_identifier(tmp_path: Path) -> None:
    first, second = FolderLock(tmp_path / "results"), FolderLock(tmp_path / "results")
    first.take()
    first.take()
    with pytest.raises(UsageError, match="output_directory: another"):
        second.take()
    FolderLock(tmp_path / "others").take()
    first.release()
    second.take()
    with pytest.raises(UsageError):
        first.take()
