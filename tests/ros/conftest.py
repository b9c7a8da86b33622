"""Real nodes on loopback, in a domain of their own."""

import itertools
import os
import subprocess
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import fields
from pathlib import Path

import pytest

from tests.ros.domain import free_domain

os.environ["ROS_DOMAIN_ID"] = str(free_domain())
os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
os.environ["ROS_PYTHON_CHECK_FIELDS"] = "1"
os.environ["RCUTILS_COLORIZED_OUTPUT"] = "0"

import rclpy
from std_srvs.srv import Trigger

from idim_iv_ros import load_configuration
from idim_iv_ros.excitation.excite import random_motion
from idim_iv_ros.nodes.settings import RecorderSettings
from idim_iv_ros.simulators.recording import simulate
from tests.ros.identifier_client import IdentifierClient
from tests.ros.processes import ROOT, Observer, Process, Robot, start_node, start_recorder


@pytest.fixture(scope="session", autouse=True)
def ros() -> Iterator[None]:
    rclpy.init()
    yield
    rclpy.try_shutdown()


@pytest.fixture(scope="session")
def observer(ros: None) -> Iterator[Observer]:
    yield Observer()  # not destroyed: see `node_alone`


@contextmanager
def another_context() -> Iterator[Callable[..., None]]:
    """Begin ROS once more in this process, with arguments and parameters, for a while.

    Its nodes hear each other and no others.
    """

    def begin(*arguments: str, **parameters: object) -> None:
        given = [text for item in parameters.items() for text in ("-p", ":=".join(map(str, item)))]
        rclpy.init(args=["test", "--ros-args", *arguments, *given])

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("rclpy.utilities.g_default_context", None)
        patch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "OFF")  # see `node_alone`
        yield begin
        rclpy.try_shutdown()


@pytest.fixture
def begin_ros() -> Iterator[Callable[..., None]]:
    """`another_context` for the nodes of one test."""
    with another_context() as begin:
        yield begin


@pytest.fixture
def stack() -> Iterator[ExitStack]:
    with ExitStack() as stack:
        yield stack


@pytest.fixture
def bags(tmp_path: Path) -> Path:
    folder = tmp_path / "bags"
    folder.mkdir()
    return folder


@pytest.fixture
def mortal_recorder(
    bags: Path, tmp_path: Path, stack: ExitStack, observer: Observer
) -> Callable[..., Process]:
    """Start a recorder for one test; the observer follows it."""

    def start(**parameters: object) -> Process:
        process = start_recorder(tmp_path, **{"bag_directory": str(bags), **parameters})
        stack.callback(process.end)
        observer.follow(process)
        return process

    return start


@pytest.fixture(scope="session")
def shared_recorder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Process]:
    process = start_recorder(tmp_path_factory.mktemp("recorder"))
    yield process
    process.end()


@pytest.fixture
def recorder(
    bags: Path, shared_recorder: Process, observer: Observer
) -> Iterator[Callable[..., None]]:
    """Set the recorder that all tests share, in which nothing is left of those before."""
    defaults = {
        item.name: list(item.default) if isinstance(item.default, tuple) else item.default
        for item in fields(RecorderSettings)
        if not item.metadata["read_only"]
    }

    def begin(*, record: bool = False, **parameters: object) -> None:
        observer.follow(shared_recorder)
        # The configuration is last: its topics count from zero.
        values = {**defaults, "minimum_free_disk": 0, "bag_directory": str(bags), **parameters}
        values["configuration"] = str(values.pop("configuration"))
        assert all(result.successful for result in observer.set(**values))
        observer.up_to_date()
        if record:
            observer.call("start")

    yield begin
    observer.follow(shared_recorder)
    observer.request(Trigger, f"/{observer.name}/stop")  # if it records
    idle = bags.parent / "idle.yaml"
    idle.write_text("robot:\n  joints: [a]\nsignals:\n  joint_states: /idle\n")
    assert observer.set(configuration=str(idle), snapshot_duration=0.0)[0].successful


@pytest.fixture(scope="session")
def robots(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Robot]:
    process = Robot(tmp_path_factory.mktemp("robot"), "robot")
    yield process
    process.kill()


@pytest.fixture
def robot(robots: Robot) -> Iterator[Robot]:
    """A process whose nodes a test makes with `begin`; they end with it."""
    yield robots
    if robots.busy:
        robots.end()


@pytest.fixture
def robot_file(tmp_path: Path) -> Callable[[str], Path]:
    """Write the configuration of a robot."""

    def write(text: str) -> Path:
        path = tmp_path / "robot.yaml"
        path.write_text(text)
        return path

    return write


@pytest.fixture
def configuration(robot_file: Callable[[str], Path]) -> Path:
    """Two joints and a reference."""
    return robot_file(
        "robot:\n  joints: [a, b]\n"
        "signals:\n  joint_states: /joint_states\n  reference: /joint_reference\n"
    )


@pytest.fixture
def mortal(robot_file: Callable[[str], Path]) -> tuple[Path, str]:
    """A configuration, and its topic of joint states, which no other test uses.

    Who is killed seems to be there for another 20 s, to all who look for those of its topics.
    """
    topic = f"/mortal_{next(_numbers)}"
    return robot_file(f"robot:\n  joints: [a, b]\nsignals:\n  joint_states: {topic}\n"), topic


@pytest.fixture
def small_disk(tmp_path: Path):
    """Six megabytes."""
    folder = tmp_path / "small"
    folder.mkdir()
    mounted = subprocess.run(["mount", "-t", "tmpfs", "-o", "size=6m", "tmpfs", folder])
    if mounted.returncode:
        pytest.skip("mounting a small disk needs root")
    yield folder
    subprocess.run(["umount", "-l", folder], check=True)


_numbers = itertools.count()
ARM2 = ROOT / "config" / "arm2.yaml"


@pytest.fixture(scope="session")
def simulated_bags(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with `bag-1.mcap` and `bag-2.mcap`, ten seconds each of the arm with two joints."""
    folder = tmp_path_factory.mktemp("simulated")
    configuration = load_configuration(ARM2)
    motion = random_motion(configuration, duration=10.0, rate=1000.0, seed=1)
    simulate(configuration, folder / "bag.mcap", motion, seeds=(1, 2))
    return folder


def start_identifier(
    stack: ExitStack, folder: Path, observer: Observer, *remappings: str, **parameters: object
) -> IdentifierClient:
    """Start an identifier that writes into the folder `results` in `folder`.

    Its jobs wait where the test says so: see `IdentifierClient.closed_gate`.
    """
    values = {
        "configuration": ARM2,
        "output_directory": folder / "results",
        "status_period": 0.2,
        **parameters,
    }
    gated = ROOT / "tests" / "ros" / "gated_identifier.py"
    process = start_node("identifier", folder, *remappings, script=gated, **values)
    stack.callback(process.end)
    client = IdentifierClient(observer, process)
    stack.callback(client.close)
    return client
