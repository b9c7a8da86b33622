"""Two robots in two namespaces: the same nodes, the same configuration, nothing mixed up."""

import json
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from std_msgs.msg import Bool, String

from idim_iv_ros import DataError, identify, load_configuration, write_bag
from idim_iv_ros.cli.main import main
from idim_iv_ros.excitation import random_motion
from idim_iv_ros.model import read_urdf_file
from idim_iv_ros.recording import read_recordings
from idim_iv_ros.recording.bags.folder import Bag
from idim_iv_ros.simulators.recording import recorded_topics
from idim_iv_ros.simulators.robot import simulated_robot
from tests.ros.conftest import ARM2
from tests.ros.identifier_client import IdentifierClient
from tests.ros.processes import LATCHED, Observer, Process, Robot, only_bag, start_node
from tests.ros.true_parameters import require_truth

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
    heard: dict[str, str] = {}

    def diagnosed(message: DiagnosticArray) -> None:
        heard.update({each.name: each.message for each in message.status})

    subscription = observer.node.create_subscription(DiagnosticArray, "/diagnostics", diagnosed, 10)
    for process in recorders.values():
        observer.until(lambda name=process.name: f"/{name}: recording" in heard, process.name)
    names = ["/left/joint_states", "/left/joint_reference"]
    names += ["/right/joint_states", "/motion/reference"]
    robot.begin(topics=[{"name": name} for name in names], description="<robot name='both'/>")
    sent = robot.run()
    closed = {}
    for side, process in recorders.items():
        observer.follow(process)
        states = f"/{side}/joint_states"
        observer.received(sent, states)
        observer.received(1, "/robot_description")
        # The global description does where the namespace has none: no warning for either.
        observer.diagnosed(f"/{side}/robot_description", " Hz", 0)
        assert observer.call("stop").success
        closed[side] = only_bag(tmp_path / side)
    observer.node.destroy_subscription(subscription)
    (left, right) = ({*Bag(bag).known_topics()} for bag in closed.values())
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


def test_an_identifier_takes_the_robot_of_its_namespace(
    start, observer: Observer, stack: ExitStack, tmp_path: Path
) -> None:
    configuration = load_configuration(ARM2)
    urdf = configuration.robot.urdf
    simulated = simulated_robot(configuration, read_urdf_file(urdf), urdf.name)
    motion = random_motion(configuration, duration=3.0, rate=1000.0, seed=1)
    topics = {
        side: [
            replace(topic, name=f"/{side}/{topic.name}")
            for topic in recorded_topics(configuration, simulated, simulated.record(motion, seed))
        ]
        for seed, side in enumerate(SIDES)
    }
    (tmp_path / "bags").mkdir()
    write_bag(tmp_path / "bags" / "both.mcap", [*topics["left"], *topics["right"]])
    write_bag(tmp_path / "right.mcap", topics["right"])
    with pytest.raises(DataError, match="may be /left/joint_states or /right/joint_states"):
        identify([tmp_path / "bags" / "both.mcap"], configuration, estimator="idim-ls")
    expected = identify([tmp_path / "right.mcap"], configuration, estimator="idim-ls")
    process = start(
        "identifier",
        "right",
        configuration=ARM2,
        bag_directory=tmp_path / "bags",
        output_directory=tmp_path / "results",
        status_period=0.2,
    )
    client = IdentifierClient(observer, process)
    stack.callback(client.close)
    answer = client.identify("both.mcap", estimator="idim-ls")
    assert answer.success, answer.message
    found = {each.name: each.value for each in answer.result.parameters.estimates}
    assert found == pytest.approx({each.name: each.value for each in expected.parameters})


@pytest.mark.parametrize(
    ("given", "status", "passed"),
    [
        (["--namespace", "left"], 0, ["-r", "__ns:=/left"]),
        (["--namespace", "/cell/left"], 0, ["-r", "__ns:=/cell/left"]),
        (
            ["--ros-args", "-r", "__ns:=/left", "--log-level", "debug"],
            0,
            ["--ros-args", "-r", "__ns:=/left", "--log-level", "debug"],
        ),
        (["--namespace", "left arm"], 2, None),
        (["--namespcae", "left"], 2, None),
        (["bags", "--ros-args", "-r", "__ns:=/left"], 2, None),
    ],
)
def test_command_line_passes_the_namespace_and_arguments_of_ros(
    given: list[str], status: int, passed: list[str] | None, monkeypatch, capsys, tmp_path: Path
) -> None:
    started: list[list[str]] = []
    monkeypatch.setattr(
        "idim_iv_ros.nodes.recorder.node.run", lambda arguments: started.append(arguments) or 0
    )
    command = ["idim-iv", "record", "--config", str(ARM2), "--out", str(tmp_path), *given]
    monkeypatch.setattr("sys.argv", command)
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == status
    assert [arguments[-len(passed or []) :] for arguments in started] == (
        [passed] if passed else []
    )
    assert len(capsys.readouterr().err.splitlines()) == (0 if status == 0 else 1)


@pytest.mark.load
def test_two_simulators_recorders_and_identifiers_at_once(
    start, observer: Observer, stack: ExitStack, tmp_path: Path
) -> None:
    """End to end: each identifier finds the truth of its own robot, in every bag it hears of."""
    text = ARM2.read_text().replace("urdf: ", f"urdf: {ARM2.parent}/")
    assert "Fc1: 1.5012" in text
    files = {}
    for side, friction in zip(SIDES, ("1.5012", "2.5"), strict=True):
        files[side] = tmp_path / f"{side}.yaml"
        files[side].write_text(text.replace("Fc1: 1.5012", f"Fc1: {friction}"))
    processes = {}
    for side, file in files.items():
        folder = tmp_path / side
        recorder = start(
            "recorder", side, configuration=file, bag_directory=folder / "bags", status_period=0.2
        )
        processes[side] = (
            start("robot_simulator", side, configuration=file),
            recorder,
            start(
                "identifier",
                side,
                f"recorder/bag_closed:={recorder.name.partition('/')[2]}/bag_closed",
                configuration=file,
                bag_directory=folder / "bags",
                output_directory=folder / "results",
                auto=True,
                status_period=0.2,
            ),
        )
    truths: dict[str, str] = {}
    moving: dict[str, list[bool]] = {side: [] for side in SIDES}
    for side, (simulator, _, _) in processes.items():
        observer.node.create_subscription(
            String,
            f"/{simulator.name}/truth",
            lambda message, side=side: truths.update({side: message.data}),
            LATCHED,
        )
        observer.node.create_subscription(
            Bool,
            f"/{simulator.name}/moving",
            lambda message, side=side: moving[side].append(message.data),
            LATCHED,
        )
    observer.until(lambda: all(moving.values()), "simulators that are ready")
    clients = {side: IdentifierClient(observer, each[2]) for side, each in processes.items()}
    for simulator, recorder, _ in processes.values():
        observer.follow(recorder)
        assert observer.call("start").success
        observer.name = simulator.name
        assert observer.call("move").success
    for side, (_, recorder, _) in processes.items():
        observer.until(lambda side=side: moving[side][-2:] == [True, False], "the motion")
        observer.follow(recorder)
        assert observer.call("stop").success
    for side, client in clients.items():
        observer.until(lambda client=client: "joint_2" in client.diagnostics, "a result")
        found = client.latched().parameters
        assert list(found.bags) == [only_bag(tmp_path / side / "bags").name]
        require_truth(found, json.loads(truths[side]))
        client.close()
    friction = {side: json.loads(truths[side])["Fc1"] for side in SIDES}
    assert friction == {"left": 1.5012, "right": 2.5}
