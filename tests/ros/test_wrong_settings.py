"""What nodes say of a configuration that is none: one line that names the parameter."""

from collections.abc import Iterator
from pathlib import Path

import pytest
import rclpy
from rclpy.node import Node

from idim_iv_ros.errors import UsageError
from idim_iv_ros.nodes.collector.neighbours import Controller
from idim_iv_ros.nodes.parameters import read_configuration
from idim_iv_ros.nodes.recorder.topics import TopicSet
from idim_iv_ros.nodes.settings import RecorderSettings
from tests.ros.conftest import ARM2


@pytest.fixture
def node() -> Iterator[Node]:
    context = rclpy.Context()
    rclpy.init(args=["--ros-args", "-p", "configuration:=/no/such.yaml"], context=context)
    node = Node("wrong", context=context)
    yield node
    node.destroy_node()
    context.try_shutdown()


@pytest.fixture
def no_topic(tmp_path: Path) -> Path:
    """A configuration whose joint states are no topic."""
    file = tmp_path / "arm.yaml"
    text = Path(ARM2).read_text().replace("states: joint_states", "states: joint states")
    file.write_text(text.replace("arm2.urdf", str(Path(ARM2).with_name("arm2.urdf"))))
    return file


def test_a_file_that_is_not_there_is_named_with_its_parameter(node: Node) -> None:
    words = "^parameter configuration: /no/such.yaml: cannot read the configuration"
    with pytest.raises(UsageError, match=words):
        read_configuration(node, "/no/such.yaml")


def test_what_is_no_topic_is_named_with_its_file(node: Node, no_topic: Path) -> None:
    words = f"^parameter configuration: {no_topic}: signals: 'joint states' is no topic of ROS"
    with pytest.raises(UsageError, match=words):
        read_configuration(node, str(no_topic))
    with pytest.raises(UsageError, match=words):
        TopicSet(node, RecorderSettings(configuration=str(no_topic)), print)


def test_a_controller_without_a_name_of_ros_is_refused(node: Node) -> None:
    for name in ("my controller", "/arm/", "1arm"):
        with pytest.raises(UsageError, match=r"^parameter controller: "):
            Controller(node, name, "topic")
