"""The SROS2 policy against the nodes as they run, and security where Fast DDS lacks it."""

import os
import subprocess
import sys
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from tests.ros.processes import HANG, ROOT, start_node

NODES = ["recorder", "identifier", "collector", "predictor", "robot_simulator"]
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
    (profile,) = [each for each in root.iter("profile") if each.get("node") == node]
    found: dict[str, set[str]] = {verb: set() for verbs in VERBS.values() for verb in verbs}
    for rule in profile:
        (verb,) = [verb for verb in VERBS[rule.tag] if rule.get(verb) == "ALLOW"]
        found[verb] |= {str(each.text).replace("~", f"/{name}") for each in rule}
    return found


@pytest.mark.parametrize("node", NODES)
def test_policy_allows_what_the_node_uses_and_no_more(node: str, observer, stack, tmp_path) -> None:
    configuration = ROOT / "config" / "arm2.yaml"
    process = start_node(node, tmp_path, configuration=configuration)
    stack.callback(process.end)
    name, seen = process.name, observer.node
    for topic, kind in PUBLISHED.items():
        stack.callback(seen.destroy_publisher, seen.create_publisher(kind, topic, 1))
    observer.until(lambda: name in seen.get_node_names(), name)
    rules = allowed(node, name)
    actions = {f"{action}/_action/" for action in rules["execute"] | rules["call"]}

    def plain(names: list) -> set[str]:
        return {each for each, _ in names if not any(each.startswith(a) for a in actions)}

    def found() -> bool:
        published = plain(seen.get_publisher_names_and_types_by_node(name, "/"))
        served = plain(seen.get_service_names_and_types_by_node(name, "/"))
        return published == rules["publish"] and served == rules["reply"]

    publishers = seen.get_publisher_names_and_types_by_node
    services = seen.get_service_names_and_types_by_node
    observer.until(
        found,
        f"{plain(publishers(name, '/')) ^ rules['publish']} "
        f"{plain(services(name, '/')) ^ rules['reply']}",
    )
    goals = {f"{action}/_action/send_goal" for action in rules["execute"]}
    observer.until(lambda: goals <= {each for each, _ in services(name, "/")}, f"{goals}")
    assert plain(seen.get_client_names_and_types_by_node(name, "/")) == rules["request"]

    def subscribed() -> set[str]:
        return plain(seen.get_subscriber_names_and_types_by_node(name, "/"))

    needed = rules["subscribe"] - EVERYWHERE
    observer.until(lambda: needed <= subscribed(), f"{needed - subscribed()}")
    assert subscribed() - rules["subscribe"] == set()


WITHOUT = (
    "DDS security is switched on (ROS_SECURITY_ENABLE) but this Fast DDS was built without it: "
    "use a full ROS 2 installation, or unset ROS_SECURITY_ENABLE"
)


def started_with_security(node: str, folder: Path, keystore: Path) -> list[str]:
    """What a node that must not start says on stderr."""
    environment = {
        **os.environ,
        "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}",
        "ROS_SECURITY_ENABLE": "true",
        "ROS_SECURITY_STRATEGY": "Enforce",
        "ROS_SECURITY_KEYSTORE": str(keystore),
    }
    script = str(ROOT / "scripts" / node)
    configured = ["-p", f"configuration:={ROOT / 'config' / 'arm2.yaml'}"]
    ended = subprocess.run(
        [script, "--ros-args", *configured],
        env=environment,
        capture_output=True,
        text=True,
        timeout=HANG,
        cwd=folder,
    )
    assert ended.returncode == 2
    return [line for line in ended.stderr.splitlines() if not line.startswith("[INFO]")]


def test_security_that_the_wheels_lack_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "enclaves").mkdir()
    assert started_with_security("identifier", tmp_path, tmp_path) == [f"identifier: {WITHOUT}"]


def test_missing_keystore_is_one_line(tmp_path: Path) -> None:
    (line,) = started_with_security("recorder", tmp_path, tmp_path / "missing")
    assert line.startswith("recorder: DDS security is switched on (ROS_SECURITY_ENABLE) and cannot")
    assert "ROS_SECURITY_KEYSTORE" in line
