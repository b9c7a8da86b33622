"""The SROS2 policy against the nodes as they run, and security where Fast DDS lacks it."""

import os
import subprocess
import sys
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from tests.ros.conftest import ARM2
from tests.ros.processes import HANG, ROOT, SETTINGS, Observer, Process, end_all, start_node

VERBS = {
    "topics": ("publish", "subscribe"),
    "services": ("reply", "request"),
    "actions": ("execute", "call"),
}
EVERYWHERE = {"/clock", "/parameter_events"}  # with use_sim_time only; rclpy's own

# What a node subscribes once it is published.
PUBLISHED = {
    "/joint_states": JointState,
    "/joint_reference": JointState,
    "/robot_description": String,
}


def allowed(node: str, name: str) -> dict[str, set[str]]:
    """Full names by verb in the profile of a node, for a node that is called `name`."""
    root = ElementTree.parse(ROOT / "security" / "policy.xml").getroot()
    (profile,) = [item for item in root.iter("profile") if item.get("node") == node]
    names: dict[str, set[str]] = {verb: set() for verbs in VERBS.values() for verb in verbs}
    for rule in profile:
        (verb,) = [verb for verb in VERBS[rule.tag] if rule.get(verb) == "ALLOW"]
        names[verb] |= {str(item.text).replace("~", f"/{name}") for item in rule}
    return names


@pytest.fixture(scope="module")
def nodes(
    observer: Observer, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[dict[str, Process]]:
    """All nodes at once, beside publishers of a robot's topics."""
    with ExitStack() as stack:
        processes = {
            node: start_node(node, tmp_path_factory.mktemp(node), configuration=ARM2)
            for node in SETTINGS
        }
        stack.callback(end_all, processes.values())
        for topic, kind in PUBLISHED.items():
            publisher = observer.node.create_publisher(kind, topic, 1)
            stack.callback(observer.node.destroy_publisher, publisher)
        yield processes


@pytest.mark.parametrize("node", SETTINGS)
def test_policy_allows_what_the_node_uses_and_no_more(
    node: str, nodes: dict[str, Process], observer: Observer
) -> None:
    name, graph = nodes[node].name, observer.node
    rules = allowed(node, name)
    actions = {f"{action}/_action/" for action in rules["execute"] | rules["call"]}
    observer.until(lambda: name in graph.get_node_names(), name)

    def names(kind: str) -> set[str]:
        listed = getattr(graph, f"get_{kind}_names_and_types_by_node")(name, "/")
        return {item for item, _ in listed if not any(item.startswith(a) for a in actions)}

    for kind, verb in (("publisher", "publish"), ("service", "reply"), ("client", "request")):
        observer.until(lambda: names(kind) == rules[verb], f"{verb} as allowed")  # noqa: B023
    served = graph.get_service_names_and_types_by_node
    goals = {f"{action}/_action/send_goal" for action in rules["execute"]}
    observer.until(lambda: goals <= {item for item, _ in served(name, "/")}, f"{goals}")
    needed = rules["subscribe"] - EVERYWHERE
    observer.until(lambda: needed <= names("subscriber"), f"{needed}")
    assert names("subscriber") - rules["subscribe"] == set()


@pytest.mark.parametrize(
    ("node", "keystore", "words"),
    [
        ("identifier", "", "but this Fast DDS was built without it: use a full ROS 2 installation"),
        ("recorder", "missing", "cannot begin"),
    ],
)
def test_security_that_cannot_begin_is_one_line(
    tmp_path: Path, node: str, keystore: str, words: str
) -> None:
    (tmp_path / "enclaves").mkdir()
    environment = {
        **os.environ,
        "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}",
        "ROS_SECURITY_ENABLE": "true",
        "ROS_SECURITY_STRATEGY": "Enforce",
        "ROS_SECURITY_KEYSTORE": str(tmp_path / keystore),
    }
    ended = subprocess.run(
        [ROOT / "scripts" / node, "--ros-args", "-p", f"configuration:={ARM2}"],
        env=environment,
        capture_output=True,
        text=True,
        timeout=HANG,
        cwd=tmp_path,
    )
    assert ended.returncode == 2
    (line,) = [line for line in ended.stderr.splitlines() if not line.startswith("[INFO]")]
    assert line.startswith(f"{node}: DDS security is switched on (ROS_SECURITY_ENABLE)")
    assert words in line
