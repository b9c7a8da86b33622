"""The `ros2` commands that users are told to paste, and the SROS2 policy, against the nodes."""

import functools
import itertools
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import fields
from types import ModuleType

import pytest
from rclpy.node import Node
from rclpy.parameter import Parameter
from ruamel.yaml import YAML
from sensor_msgs.msg import JointState

from idim_iv_ros.nodes.collector import node as collector
from idim_iv_ros.nodes.identifier import node as identifier
from idim_iv_ros.nodes.predictor import node as predictor
from idim_iv_ros.nodes.recorder import node as recorder
from idim_iv_ros.nodes.simulator import node as simulator
from tests.ros.documented_commands import Command, commands, commands_of_page, fill, interface
from tests.ros.launch_file import launch
from tests.ros.processes import ROOT, SETTINGS, Observer

BY_HAND = {"collect": "false", "predict": "false"}
LAUNCHED = {
    "demo": {},
    "demo by hand": BY_HAND,
    "demo without auto": {**BY_HAND, "auto": "false"},
    "robot": {"configuration": "arm.yaml"},
    "robot that waits": {"configuration": "arm.yaml", "autostart": "false"},
}


VERBS = {
    "topics": ("publish", "subscribe"),
    "services": ("reply", "request"),
    "actions": ("execute", "call"),
}
EVERYWHERE = {"/clock", "/parameter_events"}  # with use_sim_time only; rclpy's own


def allowed(node: str) -> dict[str, set[str]]:
    """Full names by verb in the profile of a node."""
    root = ElementTree.parse(ROOT / "security" / "policy.xml").getroot()
    (profile,) = [item for item in root.iter("profile") if item.get("node") == node]
    names: dict[str, set[str]] = {verb: set() for verbs in VERBS.values() for verb in verbs}
    for rule in profile:
        (verb,) = [verb for verb in VERBS[rule.tag] if rule.get(verb) == "ALLOW"]
        names[verb] |= {str(item.text).replace("~", f"/{node}") for item in rule}
    return names


def documented() -> list[Command]:
    """All commands, in the order of where they stand."""
    listed: list[Command] = []
    for page in (ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))):
        listed += commands_of_page(page)
    for module in (recorder, identifier, collector, predictor, simulator):
        listed += commands(f"{module.__name__} --help", module.ABOUT)
    for name, arguments in LAUNCHED.items():
        file = ROOT / "launch" / f"{name.split()[0]}.launch.py"
        listed += commands(f"{name} says", "\n".join(launch(file, **arguments).next_steps()))
    return listed


@pytest.fixture(scope="module")
def nodes(observer: Observer, tmp_path_factory: pytest.TempPathFactory) -> Iterator[list[Node]]:
    """All nodes of the demo in this process, under their names; none is spun yet."""
    arm = Parameter("configuration", value=str(ROOT / "config" / "arm2.yaml"))
    configured = functools.partial(Node, parameter_overrides=[arm])
    made = []
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(tmp_path_factory.mktemp("nodes"))
        patch.setattr(identifier, "warm", lambda: None)
        kinds: list[tuple[ModuleType, Callable]] = [
            (recorder, recorder.Recorder),
            (identifier, identifier.Identifier),
            (collector, collector.Collector),
            (predictor, predictor.Predictor),
            (simulator, simulator.RobotSimulator),
        ]
        for module, kind in kinds:
            if module is not identifier:
                patch.setattr(module, "Node", configured)
            made.append(kind())
        yield [item.node for item in made]
        for item in made:
            item.close()


def require_echo(command: Command, nodes: list[Node], _: Observer) -> None:
    """A message of the type is published, and gets to who subscribes as `ros2 topic echo` does."""
    topic, *kind = command.words
    (publisher,) = [
        publisher
        for node in nodes
        for publisher in node.publishers
        if publisher.topic_name == topic
    ]
    # With any option of QoS it would take the others from nobody: best effort, volatile.
    assert not any(option.startswith("--qos-") for option in command.options)
    assert not kind or interface(*kind) is publisher.msg_type


def require_served(command: Command, nodes: list[Node], observer: Observer) -> None:
    """The service or action is there, and has the fields that are filled in."""
    name, kind, *filled = command.words
    goal = command.verb == "action send_goal"
    service, wanted = (f"{name}/_action/send_goal", f"{kind}_SendGoal") if goal else (name, kind)

    def served() -> list[str]:
        # Not by the names of nodes: an earlier one of the same name may be remembered.
        return dict(nodes[0].get_service_names_and_types()).get(service, [])

    observer.until(served, name)
    assert served() == [wanted]
    for text in filled:
        fill(interface(kind).Goal() if goal else interface(kind).Request(), text)


def require_parameter(command: Command, nodes: list[Node], _: Observer) -> None:
    """The parameter can be set, to a value of its type."""
    name, parameter, text = command.words
    (node,) = [item for item in nodes if item.get_fully_qualified_name() == name]
    assert not node.describe_parameter(parameter).read_only
    value = YAML(typ="safe").load(text)
    assert Parameter(parameter, value=value).type_ == node.get_parameter(parameter).type_


def require_transition(command: Command, *_: object) -> None:
    """Only the managed node is asked for a transition."""
    name, transition = command.words
    assert name == "/identifier"
    assert hasattr(identifier.Identifier, f"_{transition}")


def require_executable(command: Command, *_: object) -> None:
    """The node has the parameters that it is run with."""
    package, executable, *arguments = command.words
    if package != "idim_iv_ros":
        return
    names = {item.name for item in fields(SETTINGS[executable])} | {"use_sim_time"}
    given = [value for option, value in itertools.pairwise(arguments) if option == "-p"]
    assert {value.partition(":=")[0] for value in given} <= names


def require_launch_file(command: Command, *_: object) -> None:
    """The launch file has the arguments that it is given."""
    package, file, *arguments = command.words
    assert package == "idim_iv_ros"
    given = dict(argument.split(":=") for argument in arguments)
    launched = launch(ROOT / "launch" / file, **{**given, "params_file": ""})
    assert set(given) <= set(launched.arguments)


REQUIRE = {
    "topic echo": require_echo,
    "service call": require_served,
    "action send_goal": require_served,
    "param set": require_parameter,
    "lifecycle set": require_transition,
    "run": require_executable,
    "launch": require_launch_file,
}
# One that names only the verb has no words.
COMMANDS = {str(one): one for one in documented() if one.verb in REQUIRE and one.words}


def test_every_kind_of_command_is_documented() -> None:
    assert {command.verb for command in COMMANDS.values()} == set(REQUIRE)


@pytest.mark.parametrize("command", COMMANDS.values(), ids=COMMANDS)
def test_a_documented_command_fits_the_nodes(command: Command, nodes, observer) -> None:
    REQUIRE[command.verb](command, nodes, observer)


@pytest.fixture(scope="module")
def spun(nodes: list[Node], observer: Observer) -> Iterator[None]:
    """The nodes at work, beside publishers of what they subscribe once it is published."""
    with ExitStack() as stack:
        for topic, kind in (("/joint_states", JointState), ("/joint_reference", JointState)):
            publisher = observer.node.create_publisher(kind, topic, 1)
            stack.callback(observer.node.destroy_publisher, publisher)
        for node in nodes:
            observer.executor.add_node(node)
            stack.callback(observer.executor.remove_node, node)
        yield


@pytest.mark.parametrize("node", SETTINGS)
def test_policy_allows_what_the_node_uses_and_no_more(
    node: str, spun: None, observer: Observer
) -> None:
    graph, rules = observer.node, allowed(node)
    actions = {f"{action}/_action/" for action in rules["execute"] | rules["call"]}

    def names(kind: str) -> set[str]:
        listed = getattr(graph, f"get_{kind}_names_and_types_by_node")(node, "/")
        return {item for item, _ in listed if not any(item.startswith(a) for a in actions)}

    for kind, verb in (("publisher", "publish"), ("service", "reply"), ("client", "request")):
        observer.until(lambda: names(kind) == rules[verb], f"{verb} as allowed")  # noqa: B023
    listed = graph.get_service_names_and_types_by_node
    goals = {f"{action}/_action/send_goal" for action in rules["execute"]}
    observer.until(lambda: goals <= {item for item, _ in listed(node, "/")}, f"{goals}")
    needed = rules["subscribe"] - EVERYWHERE
    observer.until(lambda: needed <= names("subscriber"), f"{needed}")
    assert names("subscriber") - rules["subscribe"] == set()
