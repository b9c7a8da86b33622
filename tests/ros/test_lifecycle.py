"""The identifier as a managed node: configured and activated when it is asked to be."""

from collections.abc import Callable
from pathlib import Path

import pytest
import rclpy
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState

from idim_iv_interfaces.srv import Identify
from idim_iv_ros.errors import UsageError
from idim_iv_ros.nodes.identifier.estimate_history import FolderLock
from idim_iv_ros.nodes.identifier.node import Identifier
from tests.ros.conftest import ARM2
from tests.ros.processes import Observer
from tests.ros.told_worker import ToldWorker


class Managed:
    """An identifier in this process, spun by an observer that calls its services."""

    def __init__(self, workers: list[ToldWorker]) -> None:
        def start_worker(request: dict, heard: Callable) -> ToldWorker:
            workers.append(ToldWorker(request, heard))
            return workers[-1]

        self.identifier, self.observer = Identifier((), start_worker), Observer()
        self.observer.executor.add_node(self.identifier.node)

    def change(self, label: str) -> bool:
        transition = Transition(label=label)
        name = "/identifier/change_state"
        return self.observer.request(ChangeState, name, transition=transition).success

    @property
    def state(self) -> str:
        return self.observer.request(GetState, "/identifier/get_state").current_state.label

    def ask(self) -> rclpy.Future:
        client = self.observer.client(Identify, "/identifier/identify")
        return client.call_async(Identify.Request(bags=["bag.mcap"]))

    def refusal(self) -> str:
        request = {"bags": ["bag.mcap"]}
        return self.observer.request(Identify, "/identifier/identify", **request).message


@pytest.fixture
def arm(robot_file: Callable[[str], Path]) -> Path:
    """A configuration that cannot be read yet."""
    return robot_file("robot:\n  joints: [a]\nnonsense: 1\n")


def test_requests_are_accepted_between_activation_and_deactivation(
    begin_ros, tmp_path: Path, arm: Path, capfd
) -> None:
    (tmp_path / "bag.mcap").write_bytes(bytes(100))
    begin_ros(
        autostart="false",
        configuration=arm,
        bag_directory=tmp_path,
        output_directory=tmp_path / "results",
        status_period=0.2,
    )
    workers: list[ToldWorker] = []
    managed = Managed(workers)

    def log() -> str:
        return capfd.readouterr().err

    assert managed.state == "unconfigured"
    assert managed.refusal() == (
        "the identifier is unconfigured: call ros2 lifecycle set /identifier configure, then "
        "ros2 lifecycle set /identifier activate"
    )
    # A file that cannot be read leaves it unconfigured, with the reason in the log.
    assert not managed.change("configure")
    assert managed.state == "unconfigured"
    reason = f"cannot configure: parameter configuration: {arm}: unknown key nonsense"
    assert reason in log()
    arm.write_text("robot:\n  joints: [a]\nsignals:\n  joint_states: joint states\n")
    assert not managed.change("configure")
    assert f"configuration: {arm}: signals: 'joint states' is no topic of ROS" in log()
    arm.write_text(ARM2.read_text().replace("urdf: ", f"urdf: {ARM2.parent}/"))
    assert managed.change("configure")
    assert managed.state == "inactive"
    assert managed.refusal() == (
        "the identifier is inactive: call ros2 lifecycle set /identifier activate"
    )
    observer, until = managed.observer, managed.observer.until
    until(lambda: observer.diagnosis("identifier", "identification")[1] == "inactive", "a status")
    assert managed.change("activate")
    assert f"ready: {arm}; identifies on request" in log()
    asked = [managed.ask() for _ in range(2)]
    until(lambda: workers and managed.identifier._jobs.waiting, "both jobs")
    assert managed.change("deactivate")
    until(lambda: all(future.done() for future in asked), "both answers")
    assert {future.result().message for future in asked} == {"the identifier was deactivated"}
    # The file is read anew when it is configured again.
    arm.write_text("nonsense: 2\n")
    assert managed.change("activate") and managed.change("deactivate")
    assert managed.change("cleanup")
    assert not managed.change("configure")
    assert managed.state == "unconfigured"
    assert managed.change("shutdown")
    assert managed.refusal() == "the identifier is finalized: start the node again"
    assert "Traceback" not in log()
    managed.identifier.close()
    managed.observer.node.destroy_node()


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
