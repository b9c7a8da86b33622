"""Two robots in two namespaces: the same nodes, the same configuration, nothing mixed up."""

import pickle
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import pytest

from idim_iv_interfaces.srv import Identify
from idim_iv_ros import DataError, identify, load_configuration, write_bag
from idim_iv_ros.cli.main import main
from idim_iv_ros.excitation.excite import random_motion
from idim_iv_ros.nodes.identifier.job_queue import JobListener
from idim_iv_ros.nodes.identifier.node import Identifier
from idim_iv_ros.nodes.parameters import declare
from idim_iv_ros.nodes.settings import IdentifierSettings
from idim_iv_ros.recording.bags.folder import Bag
from idim_iv_ros.recording.read import read_recordings
from idim_iv_ros.simulators.recording import recorded_topics, simulated_robot
from tests.ros.conftest import ARM2
from tests.ros.node_alone import node_alone
from tests.ros.processes import Observer, Process, Robot, only_bag, start_node
from tests.ros.told_worker import ToldWorker

SIDES = ("left", "right")


@pytest.fixture
def start(stack: ExitStack, tmp_path: Path) -> Callable[..., Process]:
    """Start a node in a namespace; its name is the full one."""

    def begin(executable: str, side: str, *remappings: str, **parameters: object) -> Process:
        process = start_node(executable, tmp_path, f"__ns:=/{side}", *remappings, **parameters)
        stack.callback(process.end)
        process.name = f"{side}/{process.name}"
        return process

    return begin


@pytest.fixture
def relative(robot_file: Callable[[str], Path]) -> Path:
    return robot_file("robot:\n  joints: [a, b]\nsignals:\n  reference: joint_reference\n")


def test_two_recorders_record_each_its_own_robot(
    start, relative: Path, robot: Robot, observer: Observer, tmp_path: Path
) -> None:
    recorders = {
        side: start(
            "recorder",
            side,
            *(["joint_reference:=/motion/reference"] if side == "right" else []),
            configuration=relative,
            bag_directory=tmp_path / side,
            record=True,
            minimum_free_disk=0,
            status_period=0.2,
        )
        for side in SIDES
    }
    for process in recorders.values():
        statuses = observer.statuses[process.name]
        observer.until(lambda statuses=statuses: "recording" in statuses, process.name)
    names = ["/left/joint_states", "/left/joint_reference"]
    names += ["/right/joint_states", "/motion/reference"]
    robot.begin(topics=[{"name": name} for name in names], description="<robot name='both'/>")
    sent = robot.run()
    closed = {}
    for side, process in recorders.items():
        observer.follow(process)
        observer.received(sent, f"/{side}/joint_states")
        observer.received(1, "/robot_description")
        # The global description does where the namespace has none: no warning for either.
        observer.diagnosed(f"/{side}/robot_description", " Hz", 0)
        observer.call("stop")
        closed[side] = only_bag(tmp_path / side)
    (left, right) = ({*Bag(bag).topic_types()} for bag in closed.values())
    assert left == {"/left/joint_states", "/left/joint_reference", "/robot_description"}
    assert right == {"/right/joint_states", "/motion/reference", "/robot_description"}
    configured = load_configuration(relative).signals
    given = {"joint_states": configured.joint_states, "reference": configured.reference}
    (recording,) = read_recordings([closed["left"]], joints=["a", "b"], **given)
    assert recording.robot_description == "<robot name='both'/>"
    assert recording.samples > 0.9 * sent
    # A remapping is the node's: who did not make it is told where joint states are.
    with pytest.raises(DataError, match="no topic /right/joint_reference") as refused:
        read_recordings([closed["right"]], joints=["a", "b"], **given)
    assert "/motion/reference" in str(refused.value)


def test_an_identifier_takes_the_robot_of_its_namespace(begin_ros, tmp_path: Path) -> None:
    configuration = load_configuration(ARM2)
    simulated = simulated_robot(configuration)
    motion = random_motion(configuration, duration=3.0, rate=1000.0, seed=1)
    topics = {
        side: [
            replace(topic, name=f"/{side}/{topic.name}")
            for topic in recorded_topics(simulated, simulated.record(motion, seed))
        ]
        for seed, side in enumerate(SIDES)
    }
    write_bag(tmp_path / "both.mcap", [*topics["left"], *topics["right"]])
    write_bag(tmp_path / "right.mcap", topics["right"])
    with pytest.raises(DataError, match="may be /left/joint_states or /right/joint_states"):
        identify([tmp_path / "both.mcap"], configuration, estimator="idim-ls")
    expected = identify([tmp_path / "right.mcap"], configuration, estimator="idim-ls")
    folders = {"bag_directory": tmp_path, "output_directory": tmp_path / "results"}
    begin_ros("-r", "__ns:=/right", configuration=ARM2, **folders)
    workers: list[ToldWorker] = []
    identifier = Identifier((), lambda *given: workers.append(ToldWorker(*given)) or workers[-1])
    identifier._submit("identification", Identify.Request(bags=["both.mcap"]), JobListener(print))
    identifier._jobs.poll()
    request = pickle.loads(pickle.dumps(workers[0].request))  # as it goes to another process
    identifier.close()
    result = identify(request["bags"], request["configuration"], estimator="idim-ls")
    values = {parameter.name: parameter.value for parameter in result.parameters}
    assert values == pytest.approx(
        {parameter.name: parameter.value for parameter in expected.parameters}
    )


@pytest.fixture
def started(monkeypatch: pytest.MonkeyPatch) -> list[list[str]]:
    """Arguments of the nodes that the command line starts; they do nothing."""
    started: list[list[str]] = []
    for name in ("recorder", "identifier"):
        node = f"idim_iv_ros.nodes.{name}.node.run"
        monkeypatch.setattr(node, lambda arguments: started.append(arguments) or 0)
    return started


def call(monkeypatch: pytest.MonkeyPatch, *words: object) -> int:
    monkeypatch.setattr("sys.argv", ["idim-iv", *map(str, words)])
    with pytest.raises(SystemExit) as ended:
        main()
    return int(ended.value.code or 0)


@pytest.mark.parametrize(
    ("given", "passed"),
    [
        (["--namespace", "left"], ["-r", "__ns:=/left"]),
        (["--namespace", "/cell/left"], ["-r", "__ns:=/cell/left"]),
        (["--ros-args", "-r", "__ns:=/left", "--log-level", "debug"],
         ["--ros-args", "-r", "__ns:=/left", "--log-level", "debug"]),
        (["--namespace", "left arm"], None),
        (["--namespcae", "left"], None),
        (["bags", "--ros-args", "-r", "__ns:=/left"], None),
    ],
)  # fmt: skip
def test_command_line_passes_the_namespace_and_arguments_of_ros(
    given: list[str], passed: list[str] | None, started, monkeypatch, capsys, tmp_path: Path
) -> None:
    status = call(monkeypatch, "record", "--config", ARM2, "--out", tmp_path, *given)
    assert status == (2 if passed is None else 0)
    assert [arguments[-len(passed or []) :] for arguments in started] == (
        [passed] if passed else []
    )
    assert len(capsys.readouterr().err.splitlines()) == (passed is None)


def test_idim_iv_serve_is_the_identifier_with_its_folders(started, monkeypatch, tmp_path) -> None:
    places = ("--config", ARM2, "--bags", tmp_path / "bags", "--out", tmp_path / "out")
    assert call(monkeypatch, "serve", *places, "--auto") == 0
    with node_alone("identifier", *started[0][2:]) as node:
        settings = declare(node, IdentifierSettings, started[0])
    assert (settings.configuration, settings.auto) == (str(ARM2), True)
    assert settings.bag_directory == str(tmp_path / "bags")
    assert settings.output_directory == str(tmp_path / "out")
