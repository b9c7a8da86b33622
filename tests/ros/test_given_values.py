"""What is given at the start of a node or set on it: refused in one line where it is wrong."""

import signal
import warnings
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from importlib import import_module
from pathlib import Path

import pytest
from rclpy.node import Node
from rclpy.parameter import Parameter

from idim_iv_ros.cli.nodes import ros_arguments
from idim_iv_ros.errors import UsageError
from idim_iv_ros.nodes.parameters import changed, declare, refuse_unknown_arguments
from idim_iv_ros.nodes.settings import RecorderSettings
from tests.ros.conftest import ARM2
from tests.ros.node_alone import node_alone
from tests.ros.processes import SETTINGS

KINDS = {name.removeprefix("robot_"): kind for name, kind in SETTINGS.items()}


@pytest.fixture
def node() -> Iterator[Callable[..., Node]]:
    """Make nodes that are given arguments of ROS."""
    with ExitStack() as stack:
        yield lambda *arguments: stack.enter_context(node_alone("recorder", *arguments))


@pytest.fixture
def start(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., int]]:
    """Run a node in this process, in a context of its own, and return its exit status."""
    monkeypatch.setattr("rclpy.utilities.g_default_context", None)
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "OFF")  # see `node_alone`
    handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}

    def run(name: str, *arguments: str) -> int:
        status: int = import_module(f"idim_iv_ros.nodes.{name}.node").run([name, *arguments])
        return status

    with warnings.catch_warnings():
        yield run
    for number, handler in handlers.items():
        signal.signal(number, handler)


def said(capfd: pytest.CaptureFixture[str]) -> list[str]:
    """Lines on stderr but those of the log."""
    return [line for line in capfd.readouterr().err.splitlines() if not line.startswith("[")]


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ("chunk_duration:=abc", ("chunk_duration", "'abc'", "a number", "0.1 to 10")),
        ("chunk_duration:='0.5'", ("chunk_duration", "'0.5'", "a number", "0.1 to 10")),
        ("chunk_duration:=.nan", ("chunk_duration", "nan", "a number", "0.1 to 10")),
        ("chunk_duration:=[1.0]", ("chunk_duration", "double_array", "a number")),
        ("max_file_size:=1e6", ("max_file_size", "1000000.0", "a whole number")),
        ("max_file_size:=-1", ("max_file_size", "-1", "a whole number")),
        ("record:='true'", ("record", "'true'", "true or false")),
        ("bag_prefix:=2024", ("bag_prefix", "2024", "a text")),
        ("extra_topics:=/tf", ("extra_topics", "'/tf'", "list of texts")),
        ("extra_topics:=['/a b']", ("extra_topics: '/a b' is no name of a topic",)),
        ("extra_topics_regex:='('", ("extra_topics_regex: no regular expression",)),
        ("storage_preset:=tiny", ("storage_preset", "'tiny'", "default", "small")),
        ("chunk_duraton:=1.0", ("unknown", "chunk_duraton", "chunk_duration?")),
        ("recorder:chunk_duraton:=1.0", ("unknown", "chunk_duraton", "chunk_duration?")),
    ],
)
def test_a_wrong_start_names_parameter_value_and_need(
    node, given: str, words: tuple[str, ...]
) -> None:
    arguments = ["--ros-args", "-p", given]
    with pytest.raises(UsageError) as refused:
        declare(node(*arguments[1:]), RecorderSettings, arguments)
    assert all(word in str(refused.value) for word in words), refused.value


@pytest.mark.parametrize("word", ["record:=3", "recorder:record:=false"])
def test_a_parameter_that_the_command_sets_cannot_be_set_again(word: str) -> None:
    with pytest.raises(UsageError, match=f"{word}: an option"):
        ros_arguments("", {"record": True}, ["--ros-args", "-p", word])
    ros_arguments("", {"record": True}, ["--ros-args", "-p", "bag_prefix:=a", "-r", "record:=b/c"])


@pytest.mark.parametrize("text", ["2024", "true", "~", "a: b", 'é "x" \\ #1'])
def test_the_command_line_passes_text_as_text(node, text: str) -> None:
    given = ros_arguments("", {"bag_prefix": text, "record": True}, [])[1:]
    settings = declare(node(*given[1:]), RecorderSettings, given)
    assert (settings.bag_prefix, settings.record) == (text, True)


@pytest.mark.parametrize(
    ("section", "refused"),
    [
        ("recorder", True),
        ("/**/recorder", True),
        ("/left/recorder", True),
        ("/**", False),
        ("/left/*", False),
        ("/right/recorder", None),
        ("other", None),
    ],
)
def test_an_unknown_parameter_in_a_file_is_refused_where_it_is_for_this_node_alone(
    node, tmp_path: Path, capfd, section: str, refused: bool | None
) -> None:
    file = tmp_path / "parameters.yaml"
    file.write_text(f'"{section}": {{ros__parameters: {{late_aftr: 1.0, deep: {{er: 2}}}}}}\n')
    given = ["--params-file", str(file), "-r", "__ns:=/left" if "left" in section else "a:=b"]
    made = node(*given)
    words = "late_aftr (did you mean late_after?), deep.er"
    if refused:
        with pytest.raises(UsageError) as error:
            declare(made, RecorderSettings, ["--ros-args", *given])
        assert str(error.value) == f"unknown parameter {words}"
    else:
        declare(made, RecorderSettings, ["--ros-args", *given])
        assert (words in capfd.readouterr().err) == (refused is False)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["late_after:=1.0"], "late_after:=1.0;"),
        (["--ros-args", "late_after:=1.0"], "late_after:=1.0;"),
        (["--ros-args", "--log-levl", "info"], r"--log-levl \(did you mean --log-level\?\), info"),
        (["--ros-args", "-p", "a:=1", "--", "tail"], "tail;"),
    ],
)
def test_unknown_arguments_are_named(arguments: list[str], words: str) -> None:
    with pytest.raises(UsageError, match=f"^unknown argument {words}"):
        refuse_unknown_arguments(["node", *arguments])


@pytest.mark.parametrize("name", [*KINDS, "watch"])
def test_every_node_ends_before_it_is_ready(start, capfd, name: str) -> None:
    configuration = ("--ros-args", "-p", f"configuration:={ARM2}")
    program = "robot_simulator" if name == "simulator" else name
    for arguments in ((*configuration, "-p", "tracking_eror:=0.05"), ("tracking_error:=0.05",)):
        assert start(name, *arguments) == 2
        (line,) = said(capfd)
        assert line.startswith(f"{program}: unknown ")
        assert "tracking_er" in line


@pytest.mark.parametrize(
    ("name", "given", "words"),
    [
        ("simulator", (), "robot_simulator: parameter configuration: name it: --ros-args"),
        ("predictor", (), "predictor: parameter configuration: name it: --ros-args"),
        ("recorder", ("configuration:=/no.yaml",), "parameter configuration: /no.yaml:"),
        ("collector", ("configuration:=/no.yaml",), "parameter configuration: /no.yaml:"),
        ("identifier", ("configuration:={wrong}",), "{wrong}: unknown key nonsense"),
        ("recorder", ("configuration:={no_topic}",), "{no_topic}: signals: 'joint states' is no"),
        ("collector", ("configuration:={no_topic}",), "{no_topic}: signals: 'joint states' is no"),
        *(
            ("collector", (f"controller:='{text}'",), f"collector: parameter controller: '{text}'")
            for text in ("my controller", "/arm/", "1arm")
        ),
    ],
)
def test_a_node_without_its_configuration_ends_in_one_line(
    start, capfd, tmp_path: Path, monkeypatch, name: str, given: tuple[str, ...], words: str
) -> None:
    monkeypatch.chdir(tmp_path)
    files = {"wrong": tmp_path / "wrong.yaml", "no_topic": tmp_path / "no_topic.yaml"}
    files["wrong"].write_text("robot:\n  joints: [a]\nnonsense: 1\n")
    no_topic = "robot:\n  joints: [a]\nsignals:\n  joint_states: joint states\n"
    files["no_topic"].write_text(no_topic)
    arguments = [word.format(**files) for text in given for word in ("-p", text)]
    assert start(name, "--ros-args", *arguments) == 2
    (line,) = said(capfd)
    assert words.format(**files) in line


@pytest.mark.parametrize("inside", ["", "deeper/still"])
def test_a_folder_that_cannot_be_written_is_said_at_once(
    start, capfd, tmp_path: Path, inside: str
) -> None:
    file = tmp_path / "file"
    file.write_text("")
    folder = file / inside
    assert start("recorder", "--ros-args", "-p", f"bag_directory:={folder}") == 2
    assert start("identifier", "--ros-args", "-p", f"output_directory:={folder}") == 2
    tail = f"{folder}: cannot be written: Not a directory ({file})"
    assert said(capfd) == [
        f"recorder: parameter bag_directory: {tail}",
        f"identifier: parameter output_directory: {tail}",
    ]
    with pytest.raises(UsageError, match=r"^bag_directory: "):
        changed(RecorderSettings(), [Parameter("bag_directory", value=str(folder))])
